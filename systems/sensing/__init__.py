"""Sensors of force and joint motion, and the effects of sensors and computer on a signal."""
