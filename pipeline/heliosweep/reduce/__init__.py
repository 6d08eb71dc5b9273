"""Labelled statistics over finished quantities."""
