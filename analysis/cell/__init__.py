"""Runs of the two-arm work cell, its cameras' accuracy, and its replay."""
