"""Results, checks against published values, and the report."""
