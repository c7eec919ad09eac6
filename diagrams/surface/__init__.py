"""Observers of an unknown surface's normal (the thesis)."""
