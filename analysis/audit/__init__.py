"""Finds fields of scenarios that change nothing: ``python -m chamfer.analysis.audit``."""
