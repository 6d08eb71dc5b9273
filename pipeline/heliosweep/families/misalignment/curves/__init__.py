"""Mode `curves`: deviation curves of single misalignments, their tolerances, conics and crossings with detectors."""
