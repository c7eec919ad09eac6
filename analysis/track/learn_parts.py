"""Learns what the parts look like from a picture on disk, and writes it as a scenario."""

import math
from pathlib import Path
from typing import Any, Final

import cv2

from chamfer.analysis.command.output_folder import require_writable
from chamfer.analysis.report.atomic_write import replacing, write_text
from chamfer.analysis.report.console import say
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import unstructure
from chamfer.analysis.scenario.scenario_yaml import block
from chamfer.analysis.track.detection_overlay import HOLE_COLOUR, PEG_COLOUR, Caption, draw
from chamfer.analysis.track.learning import Box, Learned, learn, read_box
from chamfer.analysis.track.recorded_frames import Frame, open_recording
from chamfer.analysis.track.track_files import FOLDER
from chamfer.systems.vision.part_detector import alignment_error

PARTS, PICTURE = "parts.yaml", "parts.png"

_HEADER: Final = """\
# What the peg and the hole part look like, learned from {picture!r}.
# chamfer track --scenario {name} FILES
"""


def learn_parts(picture: Path, peg_box: str, hole_box: str, *, out: Path) -> dict[str, Any]:
    """Learn the parts in two boxes of a picture, and write them and a picture of what was found.

    Args:
        picture: An image, or a recording of which the first frame is taken.
        peg_box: ``x,y,w,h``, pixels.
        hole_box: Likewise.
        out: The folder of all results.

    Returns:
        What was learned and the files, for JSON.

    Raises:
        UserError: If the picture can't be read, the parts can't be learned from it, or what was
            learned can't be written.
    """
    boxes = read_box(peg_box, "--peg-box"), read_box(hole_box, "--hole-box")
    frame = next(open_recording([picture]).frames())
    learned = learn(frame.image, boxes)
    looks = dict(zip(("peg", "hole"), map(unstructure, learned.looks), strict=True))
    require_writable(out, [FOLDER])
    folder = out / FOLDER
    paths = [folder / PARTS, folder / PICTURE]
    if paths[0].exists():
        say(f"{paths[0]} is replaced")
    shown = cv2.imencode(".png", _shown(frame, boxes, learned))[1]
    try:
        folder.mkdir(exist_ok=True)
        write_text(paths[0], _HEADER.format(picture=frame.name, name=PARTS) + block(looks))
        with replacing(paths[1]) as temporary:
            temporary.write_bytes(shown.tobytes())
    except OSError as error:
        raise UserError(f"{folder} can't be written: {error.strerror or error}") from error
    return {**looks, "files": [str(path) for path in paths]}


def _shown(frame: Frame, boxes: tuple[Box, Box], learned: Learned) -> cv2.typing.MatLike:
    """Return the picture with the boxes and what was found, blue, green, red."""
    image = frame.image.copy()
    for (x, y, width, height), colour in zip(boxes, (PEG_COLOUR, HOLE_COLOUR), strict=True):
        cv2.rectangle(image, (x, y), (x + width - 1, y + height - 1), colour)
    peg, hole = learned.found
    error = alignment_error(peg, hole)
    sheet = draw(image, peg, hole, error, Caption(0, math.nan, frame.name))
    return cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR)
