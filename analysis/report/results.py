"""The result of an experiment as a document, and its folder on disk."""

import io
import json
import math
import os
import platform
import shlex
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.report.atomic_write import locked
from chamfer.analysis.report.checks import Check
from chamfer.analysis.report.fingerprint import code
from chamfer.analysis.scenario.experiment import Metric

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESULT: Final = "result.json"
SWEEP: Final = "sweep.json"
SCENARIO: Final = "scenario.yaml"
REPLAY: Final = "replay.html"

_PACKAGES: Final = (
    *("drake", "numpy", "numba", "scipy", "control", "opencv", "matplotlib", "chamfer"),
)
_POINTS: Final = 72  # an inch
_FORMATS: Final[Mapping[str, Any]] = {
    "svg": {"dpi": 100},
    # A fifth larger than at the level that is the default, in a third of the time.
    "png": {"dpi": 150, "pil_kwargs": {"compress_level": 1}},
}


def defined_metrics(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return the metrics with None, and a note that says why, for what is not a finite number."""
    defined = dict(metrics)
    for name, metric in metrics.items():
        if metric.value is None or not math.isfinite(metric.value):
            said = "undefined" if metric.value is None else f"measured {float(metric.value)}"
            defined[name] = replace(metric, value=None, note=metric.note or said)
    return defined


def metric_document(metric: Metric) -> dict[str, Any]:
    """Return a metric as the result file holds it."""
    value = None if metric.value is None else float(metric.value)
    document: dict[str, Any] = {"value": value, "unit": metric.unit}
    return {**document, "note": metric.note} if metric.note else document


def check_document(check: Check) -> dict[str, Any]:
    """Return a check as the result file holds it; numbers that its relation lacks are left out."""
    of = check.published
    numbers = {"published": of.value, "tolerance": of.tolerance, "low": of.low, "high": of.high}
    return {
        "metric": of.metric,
        "relation": of.relation,
        **{name: float(number) for name, number in numbers.items() if number is not None},
        "measured": None if check.measured is None else float(check.measured),
        "unit": of.unit,
        "kind": of.kind,
        "source": of.source,
        "verdict": check.verdict,
        "ok": check.ok,
        "note": of.note,
        **({"trials": len(check.trials), "kept": check.kept} if check.trials else {}),
    }


def versions(module: str = "chamfer") -> dict[str, str | None]:
    """Return the versions of Python and packages, and a digest of the sources of the project.

    And of the package that ``module`` belongs to, where an experiment of somebody's own is.
    """
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version("opencv-python-headless" if name == "opencv" else name)
        except PackageNotFoundError:
            found[name] = None
    return found | {"sources": code((module,)).sources}


def json_text(document: Mapping[str, Any] | Sequence[Any]) -> str:
    """Return a document as a JSON text, in ASCII."""
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def command_text(
    command: str, name: str, overrides: Sequence[str], *options: str, seed: int
) -> str:
    """Return the command that makes a result."""
    words = ["chamfer", command, name]
    for override in overrides:
        words += ["--set", override]
    return shlex.join([*words, *options, *(["--seed", str(seed)] if seed else [])])


def write_folder(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write files, all of them or nothing.

    They are made in a hidden folder and then renamed into place in their order, the document
    last: whoever finds it finds its figures. A lock keeps two runs from mixing their files.

    Args:
        folder: Made if it isn't there.
        files: Their contents by name, which may be in a folder of theirs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as staging:
        for name, content in files.items():
            path = Path(staging, name)
            path.parent.mkdir(exist_ok=True)
            (folder / name).parent.mkdir(exist_ok=True)
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        with locked(folder):
            for name in files:
                os.replace(Path(staging, name), folder / name)


def read_result(path: Path) -> dict[str, Any]:
    """Return the document of a result file.

    Raises:
        ValueError: If the file is not JSON with a mapping.
        OSError: If it can't be read.
    """

    def no_number(text: str) -> float:
        raise ValueError(f"{text} is no number in JSON")

    try:
        document = json.loads(path.read_text(encoding="utf-8"), parse_constant=no_number)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(document, dict):
        raise ValueError("not a mapping")
    return document


def nested_values(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in a document's mapping, however deep, by their dotted paths."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from nested_values(inner, f"{path}.{name}" if path else str(name))
    else:
        yield path, value


def figure_captions(figures: "Mapping[str, Figure]") -> dict[str, str]:
    """Return the captions, which are the figures' labels, by file name."""
    captions = {f"{name}.svg": str(one.get_label()) for name, one in figures.items()}
    return {name: caption for name, caption in captions.items() if caption}


def figure_files(figures: "Mapping[str, Figure]") -> dict[str, bytes]:
    """Return figures by name as files, SVG and PNG, the same bytes in every run."""
    if not figures:
        return {}
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    files = {}
    # The salt makes the ids of an SVG, and a missing date its bytes, the same in every run.
    with rc_context({"svg.hashsalt": "chamfer"}):
        for name, figure in figures.items():
            # Laid out once, with an SVG's letters: to save it would draw it for that, each time.
            if (layout := figure.get_layout_engine()) is not None:
                FigureCanvasSVG(figure)
                figure.dpi = _POINTS
                layout.execute(figure)
                figure.set_layout_engine(None)
            for ending, options in _FORMATS.items():
                buffer = io.BytesIO()
                if ending == "svg":
                    caption = figure.get_label() or None
                    about = {"Date": None, "Title": name, "Description": caption}
                    options = {**options, "metadata": about}
                figure.savefig(buffer, format=ending, **options)
                files[f"{name}.{ending}"] = buffer.getvalue()
    return files
