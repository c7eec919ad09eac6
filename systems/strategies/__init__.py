"""Insertion strategies: skills for connectors and pegs, and the work cell's insertion chart."""
