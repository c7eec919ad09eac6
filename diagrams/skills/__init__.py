"""Skills of sensorimotor primitives that insert connectors (the second paper)."""
