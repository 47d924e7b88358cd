"""Physical models, one file each, with the recordings they are fitted to."""
