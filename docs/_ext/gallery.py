"""Keeps a slim copy of each experiment's result in docs/gallery, from which the site is built.

    .venv/bin/python -m docs._ext.gallery [OUT]

OUT (``out``) holds what ``chamfer reproduce --studies`` writes. Experiments that it lacks keep
their copy. Only results of the default scenario are taken, without failed trials.
"""

import io
import json
import shutil
import sys
from pathlib import Path
from typing import Any, Final

from docs._ext.pictures import GALLERY
from docs._ext.replays import packed
from PIL import Image

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.report.results import REPLAY, RESULT, read_result

STORED_REPLAY: Final = "replay.xz"
WIDEST: Final = 1472  # px, twice the width of a page
_SHARP: Final = 80_000  # bytes, up to which a picture keeps every edge
_COLOURS: Final = 128
_KEPT: Final = (
    *("experiment", "paper", "figure", "command", "seed", "scenario_sha256", "versions", "checks"),
)


def stored(name: str) -> dict[str, Any] | None:
    """Return the kept result of an experiment, None if there is none."""
    path = GALLERY / name / RESULT
    return read_result(path) if path.exists() else None


def keep(folder: Path) -> None:
    """Replace the kept copy of an experiment by that of a result's folder."""
    document = read_result(folder / RESULT)
    files: dict[str, bytes] = {}
    figures = []
    for name in document["figures"]:
        if name.endswith(".png"):
            file, svg = (str(Path(name).with_suffix(ending)) for ending in (".webp", ".svg"))
            files[file] = webp(picture(folder / name))
            drawn = b"<image" not in (folder / svg).read_bytes()
            figures.append({"file": file, "caption": document["captions"][svg], "drawn": drawn})
    if "replay" in document:
        files[STORED_REPLAY] = packed((folder / REPLAY).read_text(encoding="utf-8"))
    about = {name: document[name] for name in _KEPT}
    about["figures"] = figures
    files[RESULT] = f"{json.dumps(about, indent=1)}\n".encode()
    into = GALLERY / folder.name
    shutil.rmtree(into, ignore_errors=True)
    into.mkdir(parents=True)
    for name, content in files.items():
        (into / name).write_bytes(content)


def picture(path: Path) -> Image.Image:
    """Return a figure, at most as wide as a page shows it on a fine screen."""
    with Image.open(path) as found:
        image = found.convert("RGB")
    if image.width <= WIDEST:
        return image
    size = WIDEST, round(image.height * WIDEST / image.width)
    return image.resize(size, Image.Resampling.LANCZOS)


def webp(image: Image.Image) -> bytes:
    """Return a picture as a small file: without loss unless that takes much, as of photographs."""
    reduced = image.quantize(_COLOURS, dither=Image.Dither.NONE).convert("RGB")
    exact = _encoded(reduced, lossless=True)
    return exact if len(exact) <= _SHARP else min(exact, _encoded(image, quality=80), key=len)


def _encoded(image: Image.Image, **options: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", method=6, **options)
    return buffer.getvalue()


def main(out: Path) -> None:
    """Keep the results of a folder, forget experiments that are gone, and say the size."""
    names = [entry.name for entry in CATALOGUE.entries]
    if not any((out / name / RESULT).exists() for name in names):
        raise SystemExit(f"gallery: no result in {out}, run chamfer reproduce --studies first")
    for name in names:
        document = read_result(path) if (path := out / name / RESULT).exists() else None
        if document is None:
            print(f"{name}: no result in {out}, its copy stays")
        elif document["overrides"] or document["seed"] or document["failed_trials"]:
            print(f"{name}: not the default scenario with seed 0, its copy stays")
        else:
            keep(out / name)
    for folder in [one for one in GALLERY.glob("*") if one.name not in names]:
        shutil.rmtree(folder)
    sizes = [path.stat().st_size for path in GALLERY.rglob("*") if path.is_file()]
    print(f"{GALLERY}: {len(sizes)} files, {sum(sizes) / 1e6:.1f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
