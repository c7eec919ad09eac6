"""Finds fields of scenarios that change nothing: ``python -m analysis.audit``."""
