"""A heliostat in four measured images."""
