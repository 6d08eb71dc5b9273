"""Searches: optimisers that evaluate many points together, and their results."""
