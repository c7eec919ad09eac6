"""Blocks of the servo loops: plant, PID, state machine and trajectory compensator."""
