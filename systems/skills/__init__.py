"""Sensorimotor primitives and the skills that are composed of them."""
