"""What holds for all tests."""

from pathlib import Path

from hypothesis import settings

import chamfer

# The tests are of the tree that they stand in, whichever is installed.
chamfer.__path__[:] = [str(Path(__file__).parents[1])]

# How long an example takes depends on what else the machine does. Examples are the same each time:
# `make fuzz` alone draws new ones.
settings.register_profile("patient", deadline=None, derandomize=True, database=None)
# For whoever waits for the tests; the gate draws as many as Hypothesis does.
settings.register_profile("quick", deadline=None, derandomize=True, database=None, max_examples=30)
settings.register_profile("fuzz", deadline=None, max_examples=500)
settings.load_profile("patient")
