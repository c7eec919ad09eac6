"""What the command track says of what it has found: as a document, and as text."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from chamfer.analysis.report.check_text import number
from chamfer.analysis.report.console import table
from chamfer.analysis.scenario.scenario_io import unstructure
from chamfer.analysis.track.detection_overlay import REASONS
from chamfer.analysis.track.track_table import Track
from chamfer.analysis.track.tracking import Source, TrackScenario
from chamfer.systems.vision.part_detection import Status


def document(
    source: Source, scenario: TrackScenario, found: Track, paths: Sequence[Path]
) -> dict[str, Any]:
    """Return what was found as a document for JSON."""
    width, height = found.size
    return {
        "frames": found.frames,
        "announced_frames": source.announced,
        "unpaired_frames": source.unpaired,
        "missed_frames": found.missed,
        "interrupted": found.interrupted,
        "fault": None if found.fault is None else str(found.fault),
        "width": width,
        "height": height,
        "rate": None if math.isnan(found.rate) else found.rate,
        "both_valid": found.both_valid,
        "statuses": found.counts(),
        "scenario": unstructure(scenario),
        "files": [str(path) for path in paths],
    }


def text(said: Mapping[str, Any]) -> str:
    """Return the text of a document."""
    frames, announced = said["frames"], said["announced_frames"]
    rate = f", {number(said['rate'])} frames/s" if said["rate"] else ""
    lines = [
        f"{_frames(frames)}, {said['width']} x {said['height']} pixels{rate}, "
        f"both parts valid in {said['both_valid']}"
    ]
    early = said["interrupted"] or said["fault"]
    if announced is not None and announced > frames and not early:
        lines.append(f"  the video announces {announced} frames, the others can't be decoded")
    if said["unpaired_frames"]:
        verb = "has" if said["unpaired_frames"] == 1 else "have"
        lines.append(
            f"  {_frames(said['unpaired_frames'])} of the longer recording {verb} no partner"
        )
    if said["missed_frames"]:
        lines.append(
            f"  {_frames(said['missed_frames'])} came while others were looked at and are lost "
            "(--no-video is faster)"
        )
    rows = [
        (_name(part), str(count), REASONS[Status[status]])
        for part, counts in said["statuses"].items()
        for status, count in counts.items()
    ]
    lines += [f"  {line}" for line in table(rows, right=(1,))]
    return "\n".join([*lines, *said["files"], ""])


def _name(part: str) -> str:
    *right, name = part.split("_")
    return " ".join([*right, {"hole": "hole part"}.get(name, name)])


def _frames(number: int) -> str:
    return f"{number} frame{'s' * (number != 1)}"
