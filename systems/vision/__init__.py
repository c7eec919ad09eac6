"""Blocks that measure by sight."""
