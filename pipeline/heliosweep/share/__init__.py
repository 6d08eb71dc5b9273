"""Exchange of data with other programs, and archives for publication."""
