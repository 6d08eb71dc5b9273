"""Numerical kernels: plain mathematics on float64 arrays, SI units and radians; NumPy and numba only."""
