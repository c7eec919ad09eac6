"""A plug that is pushed into its socket by a wrist, and both without mechanics."""

from typing import NamedTuple

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.skills.connector_loop import add_connector_plant
from chamfer.models.arms.wrist import WristParams

Z = 5
ELL = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]


class Run(NamedTuple):
    depth: np.ndarray  # m
    wrench: np.ndarray  # N m above N, shape (6, n)
    displacement: np.ndarray  # rad above m, shape (6, n)

    @property
    def push(self):
        return self.wrench[Z]


def follow(connector, way, *, wrist=None, X_WS=None, X_TP=None, step=1e-3):
    """Move the carriage by way of displacements, rad above m, at times."""
    times, points = zip(*way, strict=True)
    builder = DiagramBuilder()
    plant = add_connector_plant(
        builder,
        connector,
        wrist or WristParams(),
        X_WS=X_WS or RigidTransform(),
        X_TP=X_TP or RigidTransform(),
        start=np.asarray(points[0], float),
        step=step,
    )
    path = PiecewisePolynomial.FirstOrderHold(times, np.array(points, float).T)
    desired = builder.AddSystem(TrajectorySource(path, 1))
    builder.Connect(desired.get_output_port(), plant.desired)
    ports = plant.wrench, plant.displacement
    logs = [LogVectorOutput(port, builder, step) for port in ports]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(times[-1] + 1e-4)
    wrench, displacement = (log.FindLog(simulator.get_context()).data().copy() for log in logs)
    return Run(-displacement[Z], wrench, displacement[:6])


def push_down(connector, start, bottom, duration, *, hold=0.2, back=None, **fields):
    """Push from one displacement straight down to a height.

    ``back`` is the height that it is pulled up to in a second after that.
    """
    goal = np.array([*start[:Z], bottom])
    way = [(0.0, start), (duration, goal), (duration + hold, goal)]
    if back is not None:
        way.append((duration + hold + 1.0, [*start[:Z], back]))
    return follow(connector, way, **fields)


class Geometry:
    """Plug and socket without mechanics: whether their rigid parts meet in a pose."""

    def __init__(self, connector, soft=("pins", "bottom")):
        self.soft = soft
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
        self.body = self.plant.AddRigidBody("plug")
        connector.add_socket(self.plant, RigidTransform())
        connector.add_plug(self.plant, self.body, RigidTransform())
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)

    def meet(self, X_WP):
        self.plant.SetFreeBodyPose(self.context, self.body, X_WP)
        query = self.plant.get_geometry_query_input_port().Eval(self.context)
        inspector = query.inspector()
        pairs = query.ComputePointPairPenetration()
        names = [inspector.GetName(pair.id_A) + inspector.GetName(pair.id_B) for pair in pairs]
        return any(not any(part in name for part in self.soft) for name in names)

    def free(self, R, depth, direction):
        """How far the plug moves along a direction, m, before it meets, from the origin."""
        low, high = 0.0, 1e-3
        while high - low > 1e-8:
            middle = (low + high) / 2
            p = np.array([*(middle * np.asarray(direction)), -depth])
            low, high = (low, middle) if self.meet(RigidTransform(R, p)) else (middle, high)
        return low


@pytest.fixture
def insert():
    return push_down


@pytest.fixture(name="follow")
def following():
    return follow


@pytest.fixture
def geometry_of():
    return Geometry


@pytest.fixture
def ell():
    """A Wavefront file of a prism over an L, the volume of which is 3."""
    lines = [f"v {x} {y} {z}" for z in (0, 1) for x, y in ELL]
    quads = ["1 2 3 4", "1 4 5 6"]  # anticlockwise from above
    lines += ["f " + " ".join(reversed(quad.split())) for quad in quads]
    lines += ["f " + " ".join(str(int(i) + 6) for i in quad.split()) for quad in quads]
    for i in range(6):
        j = (i + 1) % 6
        lines.append(f"f {i + 1} {j + 1} {j + 7} {i + 7}")
    return "\n".join(lines)
