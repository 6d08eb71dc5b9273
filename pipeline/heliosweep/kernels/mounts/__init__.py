"""Kernels of two-axis mounts."""
