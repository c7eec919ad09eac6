"""Surfaces that an arm, a sliding gripper and their observers share, and their friction."""
