"""What holds for all tests."""

from hypothesis import settings

# How long an example takes depends on what else the machine does.
settings.register_profile("patient", deadline=None)
# For whoever waits for the tests; the gate draws as many as Hypothesis does.
settings.register_profile("quick", deadline=None, max_examples=30)
settings.load_profile("patient")
