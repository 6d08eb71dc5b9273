"""Where the work runs, and how its progress is shown; never what it computes."""
