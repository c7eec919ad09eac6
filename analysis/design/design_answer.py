"""Answers the command, and writes the folder with the document, the page and the map."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from chamfer.analysis.design.assumptions import Assumption, assumptions
from chamfer.analysis.design.changes import Advice, Change, Pair, advise
from chamfer.analysis.design.design import Design, Verdict, Verified, assess, verify
from chamfer.analysis.design.design_map import DesignMap, MapAxis, map_design, plot_map
from chamfer.analysis.design.design_page import design_page
from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
from chamfer.analysis.design.design_words import described
from chamfer.analysis.report.results import (
    RESULT,
    SCENARIO,
    command_text,
    figure_captions,
    figure_files,
    json_text,
    versions,
    write_folder,
)
from chamfer.analysis.report.traces import table_bytes
from chamfer.analysis.scenario.experiment import Progress, part_of
from chamfer.analysis.scenario.scenario_io import scenario_text, sha256, unstructure

_MAP: Final = "map"
TRIALS: Final = 4  # insertions that are simulated beside what is certain


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The answer about a design."""

    scenario: DesignScenario  # resolved
    seed: int
    design: Design
    advice: Advice | None  # what to change; None: not asked
    map: DesignMap | None = None
    verified: Verified | None = None
    assumptions: tuple[Assumption, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The final verdict: likely where simulated insertions contradict what is certain."""
        contradicted = self.verified is not None and self.verified.warning
        return "likely" if contradicted else self.design.verdict


def answer(
    given: DesignScenario,
    *,
    what_to_change: bool = True,
    axes: Sequence[MapAxis] | None,
    trials: int | None,
    seed: int,
    progress: Progress,
) -> Answer:
    """Answer the question about an unresolved design; its open fields follow changes.

    The search for changes takes most of the time. None ``axes``: no map. ``trials`` insertions are
    simulated; None: :data:`TRIALS` where the design is certain, else none.

    Raises:
        ParameterError: If such a design is not possible.
    """
    scenario = resolve_design(given)
    design = assess(scenario, seed)
    if trials is None:
        trials = TRIALS if design.verdict == "certain" else 0
    wanted = {"changes": what_to_change, _MAP: axes is not None, "insertions": trials > 0}
    asked = [name for name, is_asked in wanted.items() if is_asked]
    stages = {
        name: part_of(progress, i / len(asked), (i + 1) / len(asked), name)
        for i, name in enumerate(asked)
    }
    return Answer(
        scenario=scenario,
        seed=seed,
        design=design,
        advice=advise(given, seed, stages["changes"]) if what_to_change else None,
        map=map_design(given, axes, seed, stages[_MAP]) if axes else None,
        verified=verify(scenario, design, trials, seed, stages["insertions"]) if trials else None,
        assumptions=assumptions(given, scenario),
    )


PAGE: Final = "design.html"


def design_document(
    name: str, answer: Answer, *, overrides: Sequence[str], wall_seconds: float
) -> dict[str, Any]:
    """Return the content of ``result.json``, in SI units, null where not finite.

    The overrides are the settings that turn the default design into this one.
    """
    design = answer.design
    plain = unstructure(answer.scenario)
    advice = answer.advice or Advice(changes=())
    least = advice.smallest
    return {
        "design": name,
        "paper": "fsm-visual-servoing",
        "figure": "section 5",
        "seed": answer.seed,
        "verdict": answer.verdict,
        "predicted_verdict": design.verdict,
        "limiting_link": design.limiting_link,
        "margin": _finite(design.margin),
        "share": {
            "value": design.share,
            "low": design.share_low,
            "high": design.share_high,
            "draws": design.draws,
        },
        "bounds": {name: _plain(one) for name, one in design.bounds.items()},
        "warnings": list(design.warnings),
        "links": [{**_plain(link), "share": _finite(link.share)} for link in design.links],
        "changes": None if answer.advice is None else [_plain(one) for one in advice.changes],
        "pairs": [_change_document(one) for one in advice.pairs],
        "smallest_change": None if least is None else _change_document(least),
        "map": None if answer.map is None else _map_document(answer.map),
        "verified": None if answer.verified is None else _plain(answer.verified),
        "assumptions": [_plain(one) for one in answer.assumptions],
        "scenario": plain,
        "scenario_sha256": sha256(plain),
        "overrides": list(overrides),
        "versions": versions(),
        "wall_seconds": round(wall_seconds, 4),
        "command": _command(name, answer, overrides),
        "figures": [] if answer.map is None else [f"{_MAP}.{end}" for end in ("svg", "png")],
        "page": PAGE,
    }


def write_design(folder: Path, answer: Answer, document: dict[str, Any]) -> None:
    """Write a design's folder as a whole; an OSError if it can't be written."""
    files: dict[str, str | bytes] = {SCENARIO: scenario_text(answer.scenario)}
    figure = None
    if answer.map is not None:
        plots = {_MAP: plot_map(answer.map)}
        figures = figure_files(plots)
        document["captions"] = figure_captions(plots)
        files |= {**figures, f"{_MAP}.parquet": table_bytes(answer.map.table())}
        figure = figures[f"{_MAP}.svg"]
    files[PAGE] = design_page(document, described(answer.scenario), figure)
    write_folder(folder, {**files, RESULT: json_text(document)})


def _change_document(change: Change | Pair) -> dict[str, Any]:
    both = {"changes": list(map(_plain, change.changes))} if isinstance(change, Pair) else {}
    return _plain(change) | both


def _map_document(found: DesignMap) -> dict[str, Any]:
    return {
        **{
            name: {"path": one.path, "unit": one.unit, "from": one.values[0], "to": one.values[-1]}
            for name, one in (("x", found.x), ("y", found.y))
        },
        "points": [len(found.x.values), len(found.y.values)],
        "computed": int(found.computed.sum()),
        "verdicts": dict(sorted(Counter(found.verdict.ravel().tolist()).items())),
        "table": f"{_MAP}.parquet",
    }


def _command(name: str, answer: Answer, overrides: Sequence[str]) -> str:
    words = []
    if answer.advice is None:
        words.append("--no-changes")
    if answer.map is not None:
        axes = (answer.map.x, answer.map.y)
        words += ["--map", *(f"{one.path}:{one.values[0]!r}:{one.values[-1]!r}" for one in axes)]
    if answer.verified is not None:
        words += ["--verify", str(answer.verified.trials + answer.verified.failed_trials)]
    elif answer.design.verdict == "certain":
        words.append("--no-verify")
    return command_text("design", name, overrides, *words, seed=answer.seed)


def _plain(value: Any) -> dict[str, Any]:
    """Return a dataclass's fields as JSON can hold them."""
    return {field.name: _finite(getattr(value, field.name)) for field in fields(value)}


def _finite(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
