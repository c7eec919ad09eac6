"""Recorded frames instead of simulated ones: the command track."""
