"""Trajectories: paths with finite acceleration and continuous velocity, and their follower."""
