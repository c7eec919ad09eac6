"""Simulations and observers beside recordings of real robots."""
