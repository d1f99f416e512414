"""report.html and index.html: the answer for people who look, in one file each that needs no network."""
