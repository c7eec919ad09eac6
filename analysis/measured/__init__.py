"""Comparisons of simulations and observers with recordings of real robots."""
