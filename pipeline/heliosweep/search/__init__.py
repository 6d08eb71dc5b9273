"""Optimisers that evaluate many points of a study together, and the results of searches."""
