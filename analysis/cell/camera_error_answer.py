"""What the study of the cameras' errors comes to, in a few sentences made of its numbers."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from analysis.cell.camera_error_kinds import CameraError
from analysis.cell.camera_error_runs import DRAWN, NONE
from analysis.published.work_cell import MEAN_ERROR
from analysis.run.experiment import Metric, Table

_MATTERS: Final = 0.25  # of the published error, from which on an error's own one is said
_SLOW: Final = 1.3  # times what is left without errors, beyond which a run is slower


def answer(errors: Sequence[CameraError], still: Table, runs: Table) -> Metric:
    """Return how many errors alone reach a published one, and in the note what the study says.

    Of the first controller and measurement that were run.
    """
    controller, measured = runs["controller"][0], runs["measured"][0]
    mine = (runs["controller"] == controller) & (runs["measured"] == measured)
    alone = {name: of[mine & np.isnan(runs["trial"])] for name, of in runs.items()}
    parts = [_biased(errors, still, measured), _slow(errors, alone), _blind(errors, still, alone)]
    parts += [_drawn({name: of[mine & ~np.isnan(runs["trial"])] for name, of in runs.items()})]
    reach = sum(_largest(still, error.name, measured)[1] >= MEAN_ERROR[1] for error in errors)
    return Metric(value=float(reach), unit="", note=" ".join(part for part in parts if part))


def _largest(still: Table, name: str, measured: str) -> tuple[float, float, float]:
    """Return the largest errors at rest: at the tip and behind it, m, rad between them."""
    of = (still["error"] == name) & (still["measured"] == measured)
    found = [still[kind][of] for kind in ("lateral_error", "rotational_error", "behind_error")]
    lateral, rotational, behind = (
        float(np.nanmax(one)) if np.isfinite(one).any() else 0.0 for one in found
    )
    return lateral, rotational, behind


def _biased(errors: Sequence[CameraError], still: Table, measured: str) -> str:
    known = [one for one in errors if (still["error"] == one.name).any()]
    if not known:
        return ""
    largest = {one.name: _largest(still, one.name, measured) for one in known}
    turns = [one for one in known if largest[one.name][1] >= _MATTERS * MEAN_ERROR[1]]
    rest = [one for one in known if one not in turns]
    said = ""
    if turns:
        each = [
            f"{one.says} ({_sized(one)}: {1e3 * largest[one.name][1]:.3g} mrad, "
            f"{1e3 * largest[one.name][2]:.2g} mm behind the tip)"
            for one in turns
        ]
        said = f"Of parts at rest what biases the angle is {_listed(each)}."
    if rest:
        worst = max(largest[one.name][1] for one in rest)
        names = _listed([one.says for one in rest])
        said += f" The loop does not care about {names}: at most {1e3 * worst:.2g} mrad."
    tip = max(known, key=lambda one: largest[one.name][0])
    value = largest[tip.name][0]
    verb = "reaches" if value >= MEAN_ERROR[0] else "does not reach"
    return (
        f"{said} At the tip no error alone comes beyond {1e3 * value:.2g} mm ({tip.says}), which "
        f"{verb} the published {1e3 * MEAN_ERROR[0]:g} mm."
    ).strip()


def _sized(error: CameraError) -> str:
    return f"{error.most:.3g} {error.unit}".rstrip()


def _slow(errors: Sequence[CameraError], runs: Table) -> str:
    """Say which errors leave more soon than late, beyond what is left without any."""
    (none,) = np.flatnonzero(runs["error"] == NONE)
    found = []
    for error in errors:
        if error.off_axis:
            continue  # its bias, either way, is no slowness
        for row in np.flatnonzero((runs["error"] == error.name) & (runs["seen"] > 0)):
            soon, late = (runs[f"{moment}.rotational_error"] for moment in ("soon", "late"))
            if soon[row] > _SLOW * soon[none] and late[row] < _SLOW * late[none]:
                found.append(
                    f"{error.says} ({1e3 * soon[row]:.3g} mrad, then {1e3 * late[row]:.3g})"
                )
    return f"Slower, but not worse in the end, it gets by {_listed(found)}." if found else ""


def _blind(errors: Sequence[CameraError], still: Table, runs: Table) -> str:
    lost = set(runs["error"][runs["seen"] < 1].tolist())
    lost |= set(still["error"][~np.isfinite(still["rotational_error"])].tolist())
    found = [one.says for one in errors if one.name in lost]
    return f"Parts get lost by {_listed(found)}." if found else ""


def _drawn(runs: Table) -> str:
    of = (runs["error"] == DRAWN) & (runs["seen"] > 0)
    if not of.any():
        return ""
    tip, angle, behind = (
        1e3 * float(runs[f"soon.{kind}"][of].mean())
        for kind in ("lateral_error", "rotational_error", "behind_error")
    )
    return (
        f"Drawn all together they leave {tip:.2g} mm at the tip, {angle:.3g} mrad and "
        f"{behind:.2g} mm behind it on the average; published are {1e3 * MEAN_ERROR[0]:g} mm, "
        f"somewhere, and {1e3 * MEAN_ERROR[1]:g} mrad."
    )


def _listed(names: Sequence[str]) -> str:
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
