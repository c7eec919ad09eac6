"""Runs a controller in its own process to drive a robot."""
