"""Measures and compares the servo loops."""
