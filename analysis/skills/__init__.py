"""Runs of skills: insertions and their metrics."""
