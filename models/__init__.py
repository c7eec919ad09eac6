"""What is simulated, without Drake systems: plants, robots, parts, surfaces, mechanics."""
