"""Logs fed to the same controllers again: what they would do."""
