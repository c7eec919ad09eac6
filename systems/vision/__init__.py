"""Blocks that measure with cameras."""
