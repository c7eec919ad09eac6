"""The loop that charges a crucible: its scenario, derived values, and the wiring."""
