"""What cameras see of the parts: how exactly, and in which conditions."""
