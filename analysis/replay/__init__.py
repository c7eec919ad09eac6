"""Feeds logs to the same controllers again."""
