"""The two-arm work cell of the first paper: alignment by vision."""
