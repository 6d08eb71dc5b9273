"""Tests of the documentation, and of what a newcomer meets."""
