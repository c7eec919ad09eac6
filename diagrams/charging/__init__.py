"""The loop that charges a crucible: its scenario, what is derived of it, and the wiring."""
