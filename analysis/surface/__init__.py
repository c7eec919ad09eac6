"""Runs along unknown surfaces, and the observers' metrics."""
