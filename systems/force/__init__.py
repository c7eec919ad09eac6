"""Blocks of force control: hybrid controller, contact detection, compensation."""
