"""Charging a crucible, mode by mode, against the limits of section 1.1.2."""
