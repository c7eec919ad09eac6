"""Runs of skills: insertions, and what they measure."""
