"""Running studies: where the work runs, how its progress is shown, what a run leaves."""
