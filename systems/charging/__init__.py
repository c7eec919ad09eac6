"""Charging a crucible: the chart that runs the cycle, and what the world answers."""
