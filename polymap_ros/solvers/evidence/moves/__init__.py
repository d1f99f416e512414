"""Moves of the search, one a file: each proposes candidates and returns the best that is worth more, or None."""
