"""Machine code for blocks: the compilers of :mod:`chamfer.models.compiled`."""

from chamfer.models.compiled import add_product, compiled, in_place, inverse, invert, within

__all__ = ["add_product", "compiled", "in_place", "inverse", "invert", "within"]
