"""Sensorimotor primitives, and skills as charts of them."""
