"""Observers of what no sensor reads: the normal of an unknown surface."""
