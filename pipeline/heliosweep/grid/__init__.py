"""Labelled, chunked grid of a study, and its plan."""
