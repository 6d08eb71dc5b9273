"""Exchange with other programs, and archives to cite and share."""
