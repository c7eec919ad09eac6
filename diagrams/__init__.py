"""The wiring: one module per closed loop, its scenario and the function that builds it."""
