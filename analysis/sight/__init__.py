"""The cameras' view of the parts: its accuracy, and its conditions."""
