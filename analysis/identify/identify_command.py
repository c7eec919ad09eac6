"""The command ``chamfer identify``: a log of a robot in, quantities and a scenario out."""

import argparse
import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue
from chamfer.diagrams.insertion.cells import CELLS

FOLDER: Final = "identify"
IDENTIFIED: Final = "identified.yaml"


def add_identify(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the folder and ``--json`` are left to be added."""
    identify: argparse.ArgumentParser = commands.add_parser(
        "identify",
        help="say what a robot's log tells: sensor, tool, stiffness, friction, delay",
        description="Reads a log of a robot that was under impedance control, touched something, "
        "or only moved, and says what it tells, each quantity with its 95 %% interval: rotation, "
        "offset, drift and noise of the force sensor, mass of the tool, stiffness and damping, "
        "friction, delay, friction of joints. What it can't tell has the reason. Writes "
        "OUT/identify: result.json, figures of what remains, and identified.yaml, which `chamfer "
        "run insertion --scenario` and `chamfer design insertion --scenario` take.",
        epilog="Quantities are time, force (of the surface on the tool), moment, position (of the "
        "tip), rotation (of the tool in the base, a rotation vector, or a quaternion, w first), "
        "velocity, reference_position (of the impedance), joint_position, joint_velocity and "
        "joint_torque. Columns such as time, force_x, Fx, 'force[0]', x or qw are found by "
        "themselves, with units as in 'force_x (lbf)'; an npz has arrays of these names.",
        allow_abbrev=False,
    )
    identify.add_argument("log", type=Path, metavar="LOG", help="a file .csv, .parquet or .npz")
    identify.add_argument(
        "--columns",
        nargs="+",
        default=[],
        metavar="NAME=COLUMNS",
        help="the columns of quantities, and their unit unless it is the SI's: "
        "force=load1,load2,load3:lbf rotation=a,b,c:deg time=stamp:ms; a name stands for "
        "name[0], name[1] and so on too, of which name[3..5] are three",
    )
    identify.add_argument(
        "--stiffness",
        type=_stiffness,
        metavar="N/m",
        help="what the impedance was set to, if it is known: it tells the unit of the forces",
    )
    identify.add_argument(
        "--cell",
        default="wam-pair",
        choices=tuple(CELLS),
        help="the cell of the insertion that identified.yaml is for (default: wam-pair)",
    )
    identify.set_defaults(command=_identify)
    return identify


def _stiffness(text: str) -> float:
    with suppress(ValueError):
        if 0 < (stiffness := float(text)) < math.inf:
            return stiffness
    raise UserError(f"--stiffness is {text!r}, allowed: a number > 0, N/m")


def _identify(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.identify.identified import identify
    from chamfer.analysis.identify.identified_scenario import fragment_text
    from chamfer.analysis.identify.log import read_log
    from chamfer.analysis.identify.log_columns import parse_columns
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.results import (
        RESULT,
        figure_files,
        json_text,
        versions,
        write_folder,
    )

    path = arguments.log
    log = read_log(path, parse_columns(arguments.columns))
    is_new = not arguments.out.exists()
    require_writable(arguments.out, [FOLDER], RESULT)
    try:
        found = identify(log, told_stiffness=arguments.stiffness)
        if all(one.value is None for one in found.quantities.values()):
            reason = next((one.note for one in found.quantities.values() if one.note), "")
            raise UserError(f"it tells nothing{': ' if reason else ''}{reason}")
    except UserError as error:
        if is_new:
            arguments.out.rmdir()
        raise UserError(f"{path}: {error}") from error
    files: dict[str, str | bytes] = {**figure_files(found.figures())}
    document = {
        "log": path.name,
        "log_sha256": sha256(path.read_bytes()).hexdigest(),
        "columns": arguments.columns,
        "rows": len(log.time),
        "seconds": float(log.time[-1]),
        "read": [name for name, _ in log.quantities()],
        "identify": {name: one._asdict() for name, one in found.quantities.items()},
        "versions": versions(),
        "figures": list(files),
        "scenario": IDENTIFIED,
    }
    files[IDENTIFIED] = fragment_text(found.quantities, arguments.cell, of=path.name)
    folder = arguments.out / FOLDER
    with written(folder):
        write_folder(folder, {**files, RESULT: json_text(document)})
    if arguments.json:
        print(json_text({**document, "folder": str(folder)}), end="")
    else:
        print("\n".join(_lines(document)))
        print(f"figures: {folder}\nscenario: {folder / IDENTIFIED}")
    return 0


def _lines(document: Mapping[str, Any]) -> list[str]:
    """Return a line a quantity that is told, and then what is to be said, once each."""
    from chamfer.analysis.report.check_text import number
    from chamfer.analysis.report.console import table

    rows, notes = [("quantity", "value", "95 % interval", "unit")], dict[str, list[str]]()
    for name, one in document["identify"].items():
        if one["value"] is not None:
            low, high = number(one["low"]), number(one["high"])
            rows.append((name, number(one["value"]), f"{low} to {high}", one["unit"]))
        if one["note"]:
            notes.setdefault(one["note"], []).append(name)
    read = f"{document['rows']} rows, {document['seconds']:.4g} s: {', '.join(document['read'])}"
    said = [f"{_together(names, document['identify'])}: {note}" for note, names in notes.items()]
    return [read, *table(rows, right=(1, 2)), *said]


def _together(names: Sequence[str], known: Collection[str]) -> str:
    """Return names in a text, ``stiffness.*`` for those of all its axes."""
    found = dict[str, None]()
    for name in names:
        group, dot, _ = name.rpartition(".")
        like = [one for one in known if group and one.startswith(group + dot)]
        found[f"{group}.*" if len(like) > 1 and set(like) <= set(names) else name] = None
    return ", ".join(found)
