"""Study families, one folder each, and modules that they share."""
