"""Exchange with the tools that users have already."""
