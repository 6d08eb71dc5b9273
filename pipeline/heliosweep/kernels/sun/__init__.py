"""Kernels of the sun and its disc."""
