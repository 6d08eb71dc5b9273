"""Kernels that compute mirror slopes from camera images."""
