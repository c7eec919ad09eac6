"""The command ``chamfer identify``: a log of a robot in, quantities and a scenario out."""

import argparse
import math
from collections.abc import Mapping
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
        help="identify sensor, tool, stiffness, friction and delay from a robot's log",
        description="Identifies quantities from a robot's log. Each has a 95 % interval, or a "
        "reason "
        "why the log does not determine it. Writes OUT/identify: result.json, figures of "
        "the residuals, and identified.yaml, a scenario for `chamfer run insertion` and "
        "`chamfer design`.",
        epilog="Quantities are time, force (of the surface on the tool), moment, position (of "
        "the tip), velocity and rotation. Others are reference_position (of the "
        "impedance), joint_position, joint_velocity and joint_torque. Rotation is that of"
        " the tool in the base frame: a rotation vector, or a quaternion with w first. "
        "Columns such as time, force_x, Fx, 'force[0]', x or qw are recognised, with "
        "units as in 'force_x (lbf)'. An npz file has arrays of these names.",
        allow_abbrev=False,
    )
    identify.add_argument("log", type=Path, metavar="LOG", help="a .csv, .parquet or .npz file")
    identify.add_argument(
        "--columns",
        nargs="+",
        default=[],
        metavar="NAME=COLUMNS",
        help="columns of a quantity, with a unit if it is not SI: force=load1,load2,load3:lbf "
        "time=stamp:ms. The text name[3..5] means three columns; name alone means "
        "name[0], name[1] and so on",
    )
    identify.add_argument(
        "--stiffness",
        type=float,
        metavar="N/m",
        help="stiffness of the impedance, if you know it: it determines the unit of the forces",
    )
    identify.add_argument(
        "--cell",
        default="wam-pair",
        choices=tuple(CELLS),
        help="the cell that identified.yaml is for (default: wam-pair)",
    )
    identify.set_defaults(command=_identify)
    return identify


def _identify(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.identify.identified import identify
    from chamfer.analysis.identify.identified_scenario import fragment_text
    from chamfer.analysis.identify.log import read_log
    from chamfer.analysis.identify.log_columns import UNITS, parse_columns
    from chamfer.analysis.report import results
    from chamfer.analysis.report.atomic_write import written
    from chamfer.analysis.report.console import say

    path, out, set_to = arguments.log, arguments.out, arguments.stiffness
    if set_to is not None and not 0 < set_to < float("inf"):
        raise UserError(f"--stiffness is {set_to:g}, allowed: a finite number > 0, N/m")
    log = read_log(path, parse_columns(arguments.columns))
    is_new = not out.exists()
    require_writable(out, [FOLDER], results.RESULT)
    try:
        found = identify(log, told_stiffness=set_to)
        told = {name for name, one in found.quantities.items() if one.value is not None}
        if not told - {"contacts"}:
            reasons = dict.fromkeys(one.note for one in found.quantities.values())
            raise UserError(f"it determines nothing: {', '.join(reasons)}")
    except UserError as error:
        if is_new:
            out.rmdir()
        raise UserError(f"{path}: {error}") from error
    if unit := found.quantities["sensor.unit"].value if "sensor.unit" in told else None:
        likely = min(UNITS["N"], key=lambda name: abs(math.log(UNITS["N"][name] / unit)))
        if likely != "N":
            say(f"forces look as if they were in {likely}: --columns force=COLUMNS:{likely}")
    plots = found.figures()
    files: dict[str, str | bytes] = {**results.figure_files(plots)}
    document = {
        "log": path.name,
        "log_sha256": sha256(path.read_bytes()).hexdigest(),
        "columns": arguments.columns,
        "rows": len(log.time),
        "seconds": float(log.time[-1]),
        "read": list(log.quantities()),
        "identify": {name: one._asdict() for name, one in found.quantities.items()},
        "versions": results.versions(),
        "figures": list(files),
        "captions": results.figure_captions(plots),
        "scenario": IDENTIFIED,
    }
    files[IDENTIFIED] = fragment_text(found.quantities, arguments.cell, of=path.name)
    folder = out / FOLDER
    with written(folder):
        results.write_folder(folder, {**files, results.RESULT: results.json_text(document)})
    if arguments.json:
        print(results.json_text({**document, "folder": str(folder)}), end="")
    else:
        print("\n".join(_lines(document)))
        print(f"figures: {folder}\nscenario: {folder / IDENTIFIED}")
    return 0


def _lines(document: Mapping[str, Any]) -> list[str]:
    """Return a line for each known quantity, and then the remarks, once each."""
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
    said = [f"{', '.join(names)}: {note}" for note, names in notes.items()]
    return [read, *table(rows, right=(1, 2)), *said]
