"""Connectors: dimensions, tolerances, and the convex pieces that they are made of in contact."""
