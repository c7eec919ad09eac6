"""Sweeps of scenario fields: design, tables and figures."""
