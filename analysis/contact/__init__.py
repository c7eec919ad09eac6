"""Runs of the hybrid force and position loops, and their metrics."""
