"""Measures the text of an SVG as a page shows it: pictures of Matplotlib and the project's own."""

import re
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

PAGE: Final = 736.0  # px, width of a page's text
LEAST: Final = 9.0  # px, smallest text there

_SVG: Final = "{http://www.w3.org/2000/svg}"
_POINT: Final = 4 / 3  # px
_GLYPHS: Final = 100.0  # Matplotlib's letters are paths of this size, scaled
_SCALE: Final = re.compile(r"scale\(([\d.]+)")


@dataclass(frozen=True)
class Shown:
    """A picture on a page; what is wider is scaled down to it."""

    width: float  # px, as drawn
    text: float  # px, smallest text on the page; infinite without any


def shown(svg: str | bytes, page: float = PAGE) -> Shown:
    """Return the sizes of a picture; subscripts count as the text that they belong to."""
    root = ElementTree.fromstring(svg)
    written = root.get("width", "")
    width = float(written.removesuffix("pt")) * (_POINT if written.endswith("pt") else 1.0)
    box = float(root.get("viewBox", f"0 0 {width} 0").split()[2])
    sizes = [float(size) for text in root.iter(f"{_SVG}text") if (size := text.get("font-size"))]
    for group in root.iter(f"{_SVG}g"):
        if group.get("id", "").startswith("text_"):
            scales = (_SCALE.search(part.get("transform", "")) for part in group.iter(f"{_SVG}g"))
            sizes += [_GLYPHS * float(found[1]) for found in scales if found]
    return Shown(width, min(width, page) / box * min(sizes, default=float("inf")))
