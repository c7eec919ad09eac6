"""Observers of the normal of an unknown surface, which no sensor measures."""
