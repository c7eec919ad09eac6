"""A controller in its own process drives a robot."""
