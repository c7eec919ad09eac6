"""Charging a crucible: nuggets, the station, and the plan of where each nugget goes."""
