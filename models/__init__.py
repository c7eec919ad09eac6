"""Simulated things without Drake systems: plants, robots, parts, surfaces, mechanics."""
