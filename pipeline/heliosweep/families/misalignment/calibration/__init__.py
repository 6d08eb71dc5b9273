"""Mode `calibration`: the errors of mounts from measured or synthetic spots, and commands that correct them."""
