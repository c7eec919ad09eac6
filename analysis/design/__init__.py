"""Insertion design: the verdict on a cell, its certainty, the limiting link and what to change."""
