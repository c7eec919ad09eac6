"""Experiments and their scenarios: from YAML and command line to parameters, and back."""
