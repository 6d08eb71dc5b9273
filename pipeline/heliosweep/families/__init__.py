"""Study families, each in its own folder, and the modules that they share."""
