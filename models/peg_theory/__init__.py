"""Theory of insertion: wedging, jamming and planar statics of a peg in a hole."""
