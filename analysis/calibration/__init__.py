"""Cameras calibrated from pictures of a board."""
