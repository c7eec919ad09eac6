"""The pictures that the repository keeps, the command that makes each, and which are stale.

A picture says which scenario it was made from: a still in its own metadata, a figure of the
gallery in the results beside it.
"""

from pathlib import Path
from typing import Final

from docs._ext.blocks import ROOT

DOCS: Final = ROOT / "docs"
GALLERY: Final = DOCS / "gallery"
STILLS: Final = {"insertion-3d.png": "insertion"}  # of an experiment's replay, in docs
COMMANDS: Final = {  # by the pictures that they make
    "docs/insertion-3d.png": "python -m docs._ext.stills out",
    "docs/gallery/*/*.webp": "python -m docs._ext.gallery out",
}
ENDINGS: Final = (".png", ".webp", ".jpg", ".svg", ".gif")


def pictures() -> list[str]:
    """Return the paths of all pictures in docs, but for what the build writes."""
    found = (path.relative_to(ROOT) for path in DOCS.rglob("*") if path.suffix in ENDINGS)
    return sorted(str(path) for path in found if "generated" not in path.parts)


def unlisted() -> list[str]:
    """Return the pictures that no command is known to make."""
    return [one for one in pictures() if not any(Path(one).match(known) for known in COMMANDS)]
