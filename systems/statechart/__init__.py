"""State charts, and the block that runs one."""
