"""Identification of sensor, tool, impedance, contact and joints from a robot's log."""
