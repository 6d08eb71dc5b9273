"""Kernels of tracking errors of dishes."""
