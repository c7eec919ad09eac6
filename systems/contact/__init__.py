"""Blocks of contact: an arm with joint friction that touches a surface."""
