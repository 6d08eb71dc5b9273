"""Mode `mount_errors`: where the six errors of a mount send the beam, fixed, swept or drawn."""
