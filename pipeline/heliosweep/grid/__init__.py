"""Labelled and chunked parameter grid of a study, and its plan."""
