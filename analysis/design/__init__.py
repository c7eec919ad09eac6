"""A cell on paper: does it insert, how sure is that, what limits it, and what to change."""
