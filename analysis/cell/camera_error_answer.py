"""What the study of the cameras' errors comes to, in a few sentences made of its numbers."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from chamfer.analysis.cell.camera_error_kinds import CameraError
from chamfer.analysis.cell.camera_error_runs import DRAWN, NONE, NOT_DRAWN, reached
from chamfer.analysis.published.work_cell import MEAN_ERROR
from chamfer.analysis.scenario.experiment import Metric, Table

_MATTERS: Final = 0.25  # of the published error, from which on an error's own one is said
_SLOW: Final = 1.3  # times what is left without errors, beyond which a run is slower


class Bias(NamedTuple):
    """What an error does to parts at rest, at the largest size at which they are found."""

    error: CameraError
    size: float  # without a sign
    lateral: float  # m, at the tip
    rotational: float  # rad
    behind: float  # m, behind the tip
    published_at: float | None  # the size that makes the published angle

    @property
    def sized(self) -> str:
        """The error with its size."""
        size = math.copysign(self.size, self.error.most)
        return f"{self.error.says} of {size:.3g} {self.error.unit}".rstrip()


def answer(errors: Sequence[CameraError], still: Table, runs: Table) -> Metric:
    """Return how many errors alone make the published angle, and in the note what the study says.

    Of the first controller and measurement that were run.
    """
    controller, measured = runs["controller"][0], runs["measured"][0]
    mine = (runs["controller"] == controller) & (runs["measured"] == measured)
    alone = {name: of[mine & np.isnan(runs["trial"])] for name, of in runs.items()}
    drawn = {name: of[mine & ~np.isnan(runs["trial"])] for name, of in runs.items()}
    rest = {name: of[still["measured"] == measured] for name, of in still.items()}
    biases = [bias for one in errors if (bias := _bias(one, rest)) is not None]
    said = [_biased(biases), _slow(errors, alone), _blind(errors, rest, alone), _drawn(drawn)]
    reach = sum(one.published_at is not None for one in biases)
    return Metric(value=float(reach), unit="", note=" ".join(text for text in said if text))


def _bias(error: CameraError, still: Table) -> Bias | None:
    of = (still["error"] == error.name) & np.isfinite(still["rotational_error"])
    if not of.any():
        return None
    size = np.abs(still["size"][of])
    lateral, rotational, behind = (
        still[kind][of] for kind in ("lateral_error", "rotational_error", "behind_error")
    )
    return Bias(
        error,
        float(size[-1]),
        float(lateral[-1]),
        float(rotational[-1]),
        float(behind[-1]),
        reached(size, rotational, MEAN_ERROR[1]),
    )


def _biased(biases: Sequence[Bias]) -> str:
    if not biases:
        return ""
    turns = [one for one in biases if one.rotational >= _MATTERS * MEAN_ERROR[1]]
    said = []
    if turns:
        each = [
            f"{one.sized} ({1e3 * one.rotational:.3g} mrad, {1e3 * one.behind:.2g} mm behind the "
            "tip)"
            for one in turns
        ]
        said.append(f"The angle is biased by {_listed(each)}.")
    for one in turns:
        if one.published_at is not None:
            size = math.copysign(one.published_at, one.error.most)
            said.append(
                f"{1e3 * MEAN_ERROR[1]:g} mrad take {size:.3g} {one.error.unit}".rstrip()
                + f" of {one.error.says}."
            )
    if rest := [one for one in biases if one not in turns]:
        worst = max(one.rotational for one in rest)
        names = _listed([one.error.says for one in rest])
        said.append(f"The loop does not care about {names}: at most {1e3 * worst:.2g} mrad.")
    tip = max(biases, key=lambda one: one.lateral)
    verb = "reaches" if tip.lateral >= MEAN_ERROR[0] else "is not"
    said.append(
        f"At the tip the largest bias is {1e3 * tip.lateral:.2g} mm, by {tip.error.says}, which "
        f"{verb} the published {1e3 * MEAN_ERROR[0]:g} mm."
    )
    return " ".join(said)


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
    said = f"It is slower, not worse in the end, by {_listed(found)}." if found else ""
    same = [
        error.says
        for error in errors
        if error.moving
        for row in np.flatnonzero((runs["error"] == error.name) & (runs["seen"] > 0))
        if runs["soon.rotational_error"][row] <= _SLOW * runs["soon.rotational_error"][none]
    ]
    return f"{said} Hardly anything is lost by {_listed(same)}.".strip() if same else said


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
    without = _listed([one.says for one in NOT_DRAWN])
    return (
        f"Drawn all together, without {without}, they leave {tip:.2g} mm at the tip, "
        f"{angle:.3g} mrad and {behind:.2g} mm behind it on the average, in "
        f"{int(of.sum())} runs; published are {1e3 * MEAN_ERROR[0]:g} mm, "
        f"the paper does not say where, and {1e3 * MEAN_ERROR[1]:g} mrad."
    )


def _listed(names: Sequence[str]) -> str:
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
