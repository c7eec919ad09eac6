"""Linear plants of the servo loops."""
