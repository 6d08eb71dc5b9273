"""Mode `detectors`: where arrays of detectors see a heliostat's traces, and its misalignment from that."""
