"""Results as archives to cite and to share: everything that opens, verifies and reruns them, in one file."""
