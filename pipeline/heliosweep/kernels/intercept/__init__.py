"""Kernels of the light that reaches a receiver: sun shapes, slope errors, curved mirrors, spillage."""
