"""Optimisers that evaluate several points of a study at once, and results of searches."""
