"""One short file per executable."""
