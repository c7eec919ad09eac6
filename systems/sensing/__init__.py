"""Sensors of force and joint motion, and what they and the computer do to a signal."""
