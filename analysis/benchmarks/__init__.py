"""The loops of the first paper in Chamfer and in other simulators, side by side."""
