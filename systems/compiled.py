"""Machine code, under the name that blocks know it by."""

from chamfer.models.compiled import add_product, compiled, inverse

__all__ = ["add_product", "compiled", "inverse"]
