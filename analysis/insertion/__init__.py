"""Insertion of a peg: forces, wedging and jamming, simulated and predicted."""
