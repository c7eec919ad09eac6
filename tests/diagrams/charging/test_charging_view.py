"""The cell to look at: each thing where the station and the positions say."""

import gc
from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.geometry import Box, Ellipsoid, Meshcat, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from chamfer.analysis.report.replay import open_meshcat
from chamfer.diagrams.charging.charging_view import ChargingView, make_charging_view, waiting_pose
from chamfer.models.arms.adept_wrist import joint_positions
from chamfer.models.charging.packing import Nugget, PlanItem, places
from chamfer.models.charging.station import Station

STATION = Station()
LYING = places(
    [PlanItem()], STATION, believed=False, laid=[PlanItem(azimuth=1.0, tilt=0.4, tilt_azimuth=2.0)]
)[0].laid[0]
PLAN = (PlanItem(kind="wall", mass=0.085), PlanItem(kind="crown", mass=0.14))


@pytest.fixture(scope="module")
def meshcat() -> Iterator[Meshcat]:
    yield open_meshcat(0)
    gc.collect()


@pytest.fixture(scope="module")
def view(meshcat: Meshcat) -> ChargingView:
    return make_charging_view(STATION, PLAN, meshcat)


def test_fingers_and_nuggets_are_where_the_positions_say(view: ChargingView) -> None:
    x = np.array([0.5, 0.2, 0.5, 0.4, 0.0, 0.1, 0.2])
    poses = np.array([[0.1, 0.0, 0.4, *x[:3]], [0.0, 0.0, 0.0, 0.3, -0.3, 0.4]])
    positions = view.positions(joint_positions(x, "positive")[np.newaxis], poses[np.newaxis])
    context = view.plant.CreateDefaultContext()
    view.plant.SetPositions(context, positions[0])

    def pose(body: str) -> np.ndarray:
        X_WB = view.plant.GetBodyByName(body).EvalPoseInWorld(context)
        return np.asarray(X_WB.GetAsMatrix34())

    # A nugget that is held hangs in the fingers, turned as they are.
    np.testing.assert_allclose(pose("nugget_1"), pose("endpoint"), rtol=0, atol=1e-12)
    np.testing.assert_allclose(pose("nugget_2")[:, 3], [0.3, -0.3, 0.4], rtol=0, atol=1e-12)


def test_nuggets_wait_in_a_row_at_the_feeder() -> None:
    first, second, *_, last = (waiting_pose(STATION, 0.03, ahead) for ahead in range(50))
    np.testing.assert_allclose(first[3:], [*STATION.feeder[:2], STATION.feeder[2] + 0.03])
    assert second[3] < first[3]
    assert last[3] > 0.0  # before the base, not through it


def test_table_carries_the_whole_row_the_crucible_leans_and_nuggets_lie(meshcat: Meshcat) -> None:
    shown: dict[str, tuple[Shape, RigidTransform]] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            MultibodyPlant,
            "RegisterVisualGeometry",
            lambda _, body, X_BG, shape, name, *__: shown.setdefault(name, (shape, X_BG)),
        )
        make_charging_view(STATION, (), meshcat, lean=0.1, laid=(LYING,))
    # The nugget that lies there is drawn as what is met of it: its top is the surface's.
    drawn, X_WN = shown["laid[0]"]
    assert isinstance(drawn, Ellipsoid)
    top = X_WN @ np.array([0.0, 0.0, drawn.c()])
    point = Nugget(mass=1.0, semi_axes=(1e-9, 1e-9, 1e-9))
    assert LYING.surface(point).level(top) == pytest.approx(0.0, abs=1e-8)
    table, X_WT = shown["feeder"]
    assert isinstance(table, Box)
    assert X_WT.translation()[2] + table.height() / 2 == pytest.approx(STATION.feeder[2])
    row = np.array([waiting_pose(STATION, 0.0, ahead)[3] for ahead in range(9)])
    for end in (row.min() - 0.03, row.max() + 0.03):  # with a nugget's reach
        assert abs(end - X_WT.translation()[0]) < table.width() / 2
    _, X_WC = shown["crucible"]
    # The solid's axis is x, from the floor on.
    middle = X_WC.multiply(np.array([STATION.bed_height, 0.0, 0.0]))
    np.testing.assert_allclose(middle, [*STATION.crucible_centre, STATION.bed_height])
    axis = X_WC.rotation().matrix()[:, 0]
    np.testing.assert_allclose(axis, [np.sin(0.1), 0.0, np.cos(0.1)], atol=1e-12)
