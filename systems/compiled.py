"""Machine code, under the name that blocks know it by."""

from chamfer.models.compiled import add_product, compiled, in_place, inverse, invert, within

__all__ = ["add_product", "compiled", "in_place", "inverse", "invert", "within"]
