"""Trajectories: paths with finite acceleration and continuous velocity, and who follows them."""
