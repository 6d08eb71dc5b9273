"""One simulated heliostat."""
