"""Kernels of spots of misaligned heliostats on the receiver plane."""
