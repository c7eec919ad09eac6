"""Simulate, measure, compare with the papers, plot, report, and the command line."""
