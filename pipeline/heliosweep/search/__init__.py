"""Searches: optimisers that evaluate many points at a time, and their results."""
