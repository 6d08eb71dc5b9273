"""Kernels of slopes of mirrors from camera images."""
