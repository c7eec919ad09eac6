"""Cameras: projection, lenses, placement and the files that describe them."""
