"""From a study to a labelled, chunked grid, and what it will cost."""
