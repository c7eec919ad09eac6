"""Whether both cameras have the parts in their images where a compensation begins."""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_cameras import VIEWS, believed_camera, camera_placement
from chamfer.diagrams.cell.start_apart import offset_pose, true_pose, wrong_pose
from chamfer.diagrams.cell.work_cell import ArmName
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.peg.part_surfaces import rings
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_SIDES: Final = 16  # points of an edge
# Pixels, half of a part's width: of smaller ones most pictures show no end to be measured.
_NARROWEST: Final = 5.0
_SEEN: Final[dict[ArmName, str]] = {"peg": "the peg's tip", "hole": "the hole part's front face"}


def require_in_view(scenario: AlignmentScenario) -> None:
    """Refuse parts whose end faces are not in both images, where the compensation begins.

    The arms are taken to be where their commands and their bases make them be.

    Raises:
        ParameterError: It names the field that takes a part out of an image.
    """
    for arm, seen in _SEEN.items():
        for name, value, X_WT in _poses(scenario, arm):
            face = _end_face(scenario.parts, arm)
            if where := _outside(scenario, X_WT, face):
                if name == "gap":
                    name, value = _camera_field(scenario, X_WT, face) or (name, value)
                raise ParameterError(
                    name,
                    value,
                    f"one with which both cameras have {seen} in their images when the "
                    f"compensation begins; {where}",
                )


def require_fine_enough(scenario: AlignmentScenario) -> None:
    """Refuse pixels that are too large for the parts to be found.

    Raises:
        ParameterError: It names the pixels' size and says how large they may be.
    """
    cameras, parts = scenario.cameras, scenario.parts
    narrower = min(parts.peg_radius, parts.outer_radius)
    for view in VIEWS:
        most = narrower / _NARROWEST / cameras.pixel_scale(view)
        if cameras.pixel_size > most:
            wide = f"{2 * _NARROWEST:g} pixels wide in the {view} camera"
            allowed = f"at most {most:.3g} m, so that both parts are {wide}"
            raise ParameterError("cameras.pixel_size", cameras.pixel_size, allowed)


def _poses(
    scenario: AlignmentScenario, arm: ArmName
) -> Iterator[tuple[str, object, RigidTransform]]:
    """Yield fields that move a part, their values, and where it is with these and those before."""
    X_WT = scenario.nominal_pose(arm)
    yield "gap", scenario.gap, X_WT
    if arm == "peg":
        share = min(scenario.begin / scenario.motion_time, 1.0)
        left = 1 - share**2 * (3 - 2 * share)  # of a cubic from rest to rest
        X_WT = offset_pose(scenario, left)
        yield "start_offset", scenario.start_offset, X_WT
        X_WT = wrong_pose(scenario, X_WT)
        yield "initial_error", scenario.initial_error, X_WT
    yield f"{arm}.base_error", getattr(scenario, arm).base_error, true_pose(scenario, arm, X_WT)


def _camera_field(
    scenario: AlignmentScenario, X_WT: RigidTransform, p_T: Array
) -> tuple[str, object] | None:
    """Return the first field of a camera without which it sees a part, and its value, if any."""
    for view in VIEWS:
        settings = scenario.cameras.view(view)
        stand = CameraModel.like(camera_placement(scenario.cameras, scenario, view).camera)
        for which in ("true", "believed"):
            model: CameraModel = getattr(settings, which)
            for one in fields(CameraModel):
                value, stands = getattr(model, one.name), getattr(stand, one.name)
                if value in (None, stands):
                    continue
                other: CameraModel = replace(model, **{one.name: stands})
                as_stands = (
                    replace(settings, true=other)
                    if which == "true"
                    else replace(settings, believed=other)
                )
                cameras = scenario.cameras.with_view(view, as_stands)
                if not _outside(replace(scenario, cameras=cameras), X_WT, p_T):
                    return f"cameras.{view}.{which}.{one.name}", value
    return None


def _end_face(parts: PegAndHole, arm: ArmName) -> Array:
    """Return the middle and the edge of the end face that the cameras look for, m, (n, 3)."""
    profile = parts.peg.profile[-1:] if arm == "peg" else parts.hole.outside[:1]
    return np.vstack([np.zeros(3), *rings(profile, _SIDES, parts.section)])


def _outside(scenario: AlignmentScenario, X_WT: RigidTransform, p_T: Array) -> str:
    """Return where points of a part are in an image that ends before it, empty if all are in."""
    p_W = p_T @ X_WT.rotation().matrix().T + X_WT.translation()
    for view in VIEWS:
        camera = scenario.camera(view)
        believed = believed_camera(scenario.cameras, scenario, view)
        pixels = camera.project(p_W)
        if np.isnan(pixels).any():
            lens = "" if camera.lens is None else ", or where its lens shows nothing"
            return f"it is behind the {view} camera{lens}"
        pixel = scenario.cameras.pixel_size
        size = f"{camera.width} x {camera.height} pixels of {pixel:g} m"
        straight = believed.straight()
        for as_seen, by, seen in (
            ("", camera, pixels),
            ("straightened, ", straight, believed.straightened(pixels)),
        ):
            last = np.array([by.width - 1, by.height - 1])
            inside = ((seen >= 0) & (seen <= last)).all(axis=1)
            if not inside.all():
                u, v = seen[~inside][0].tolist()
                return f"in that of {view}, {as_seen}{size}, it is at ({u:.4g}, {v:.4g})"
    return ""
