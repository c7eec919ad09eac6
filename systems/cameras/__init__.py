"""Cameras with their lenses and sensors, and the frames that they deliver."""
