"""A peg on a spring support that is pushed into its hole."""
