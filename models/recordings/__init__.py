"""Recordings of real robots, with their sources and licences."""
