"""The best point of a study: optimisers that ask for many points at a time, and what they leave."""
