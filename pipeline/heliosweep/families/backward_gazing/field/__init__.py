"""Simulated heliostats of a field at some hours."""
