"""Runs of studies: workers, progress, and the files of a run."""
