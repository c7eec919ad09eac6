"""The pictures that the repository keeps, the command that makes each, and the stale ones.

A picture names the scenario it was made from: a still in its own metadata, a figure of the gallery
in the result next to it.
"""

import warnings
from collections.abc import Iterator
from typing import Final

from docs._ext.blocks import ROOT
from PIL import Image

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare
from chamfer.analysis.report.results import RESULT, read_result
from chamfer.analysis.scenario.scenario_io import sha256, unstructure

DOCS: Final = ROOT / "docs"
GALLERY: Final = DOCS / "gallery"
STILLS: Final = {"insertion-3d.png": "insertion"}  # in docs, by the experiment whose replay it is
COMMANDS: Final = {  # by the pictures that they make
    "docs/insertion-3d.png": "python -m docs._ext.stills out",
    "docs/gallery/*/*.webp": "python -m docs._ext.gallery out",
}
ENDINGS: Final = (".png", ".webp", ".jpg", ".svg", ".gif")


def unlisted() -> list[str]:
    """Return the pictures in docs that no command is known to make."""
    found = (path.relative_to(ROOT) for path in DOCS.rglob("*") if path.suffix in ENDINGS)
    return sorted(
        str(path)
        for path in found
        if "generated" not in path.parts and not any(path.match(one) for one in COMMANDS)
    )


def stale() -> Iterator[str]:
    """Yield a line for each stored picture or result that is not of today's experiments."""
    today = hashes()
    for name, experiment in STILLS.items():
        with Image.open(DOCS / name) as still:
            if still.info.get("scenario_sha256") != today[experiment]:
                yield f"docs/{name}: {experiment} has another default scenario: make gallery"
    for folder in sorted(GALLERY.iterdir()):
        where = f"docs/gallery/{folder.name}"
        if folder.name not in today:
            yield f"{where}: no such experiment, delete it"
            continue
        result = read_result(folder / RESULT)
        if result["scenario_sha256"] != today[folder.name]:
            yield f"{where}: another default scenario: chamfer run {folder.name}; make gallery"
        named = {one["file"] for one in result["figures"]}
        there = {path.name for path in folder.iterdir() if path.suffix in ENDINGS}
        if named != there:
            yield f"{where}: {', '.join(sorted(named ^ there))} is missing or not in {RESULT}"


def missing() -> list[str]:
    """Return the experiments without a stored result."""
    names = [entry.name for entry in CATALOGUE.entries]
    return [name for name in names if not (GALLERY / name / RESULT).exists()]


def hashes() -> dict[str, str]:
    """Return the digest of each experiment's default scenario, as its results have it."""
    with warnings.catch_warnings(action="ignore"):  # of a default that is unstable, as the paper's
        jobs = prepare(CATALOGUE.entries)
    return {job.entry.name: sha256(unstructure(job.scenario)) for job in jobs}
