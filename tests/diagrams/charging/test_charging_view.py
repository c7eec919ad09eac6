"""The cell to look at: each thing where the station and the positions say."""

import gc
from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from analysis.run.replay import open_meshcat
from diagrams.charging.charging_view import ChargingView, make_charging_view, waiting_pose
from models.arms.adept_wrist import joint_positions
from models.charging.packing import PlanItem
from models.charging.station import Station

STATION = Station()
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


def test_draws_each_nugget_and_publishes(view: ChargingView, meshcat: Meshcat) -> None:
    view.diagram.ForcedPublish(view.diagram.CreateDefaultContext())
    for index in range(len(PLAN)):
        assert meshcat.HasPath(f"charging/nuggets/nugget_{index + 1}")
    for name in ("crucible", "bed", "feeder", "scanner"):
        assert meshcat.HasPath(f"charging/{name}")


def test_nuggets_wait_in_a_row_at_the_feeder() -> None:
    first, second, *_, last = (waiting_pose(STATION, 0.03, ahead) for ahead in range(50))
    np.testing.assert_allclose(first[3:], [*STATION.feeder[:2], STATION.feeder[2] + 0.03])
    assert second[3] < first[3]
    assert last[3] > 0.0  # before the base, not through it
