"""Blocks of force control: hybrid controller, contact detection, sensors, compensation."""
