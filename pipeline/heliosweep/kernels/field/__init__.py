"""Kernels of shading and blocking in a field of heliostats."""
