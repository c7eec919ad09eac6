"""A cube that is tossed on a board, under a contact setting of Drake's MultibodyPlant."""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus
from scipy.spatial.transform import Rotation

from chamfer.models.recordings import recordings as cube
from chamfer.systems.contact.contact_approximation import Approximation, approximate

Array = NDArray[np.float64]

_PLANT: Final = "cube and board"
_BOARD: Final = (6.0, 6.0, 0.5)  # m, wider than any cube slides
_POINT: Final = 1e-3  # m, radius of the spheres at the corners


class TossContact(NamedTuple):
    """Contact between cube and board."""

    approximation: Approximation  # of contact, by Drake
    stiffness: float | None  # N/m, of each part; None: Drake's, for 1 mm under the weight
    dissipation: float | None  # s/m, of Hunt and Crossley; None: Drake's; not of sap
    stiction: float = 1e-3  # m/s, speed below which a contact sticks, creeping; not of sap
    step: float = 1e-3  # s, of the plant
    friction: float = 0.18  # mu, Coulomb's
    shape: Literal["box", "corners"] = "box"  # touches at one point; or eight spheres, at each


class Flight(NamedTuple):
    """A simulated toss, n rows at the recording's rate."""

    orientation: Array  # (n, 4), unit quaternion w, x, y, z
    position: Array  # (n, 3), m
    normal_impulse: float  # N s, of the board on the cube, over the whole of it
    friction_impulse: float  # N s, likewise, the sum of the sizes


def make_toss_diagram(contact: TossContact) -> Diagram:
    """Return the cube above the board, in the recordings' frame."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, contact.step)
    plant.set_name(_PLANT)
    approximate(plant, contact.approximation)
    plant.set_stiction_tolerance(contact.stiction)
    about = UnitInertia.TriaxiallySymmetric(cube.CUBE_INERTIA / cube.CUBE_MASS)
    body = plant.AddRigidBody("cube", SpatialInertia(cube.CUBE_MASS, np.zeros(3), about))
    touch, mu = ProximityProperties(), CoulombFriction(contact.friction, contact.friction)
    AddContactMaterial(contact.dissipation, contact.stiffness, mu, touch)
    pieces = {"box": (Box(*[cube.CUBE_WIDTH] * 3), np.zeros(3))}
    if contact.shape == "corners":
        signs, middle = 2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1, cube.CUBE_WIDTH / 2 - _POINT
        pieces = {f"corner {one}": (Sphere(_POINT), middle * one) for one in signs}
    for name, (shape, p_BS) in pieces.items():
        plant.RegisterCollisionGeometry(body, RigidTransform(p_BS), shape, name, touch)
    X_WB = RigidTransform([0.0, 0.0, cube.CUBE_GROUND - _BOARD[2] / 2])
    plant.RegisterCollisionGeometry(plant.world_body(), X_WB, Box(*_BOARD), "board", touch)
    plant.Finalize()
    return builder.Build()


def rotations(orientation: Array) -> Rotation:
    """Return quaternions w, x, y, z, shape (n, 4), as rotations R_WB."""
    return Rotation.from_quat(orientation, scalar_first=True)


def fly(diagram: Diagram, toss: cube.Toss) -> Flight:
    """Simulate a toss from its first row on, for the length of its recording.

    Recorded angular velocities are in the cube's axes, the plant's are in the board's.
    """
    plant = diagram.GetSubsystemByName(_PLANT)
    assert isinstance(plant, MultibodyPlant)
    root = diagram.CreateDefaultContext()
    context, R_WB = plant.GetMyMutableContextFromRoot(root), rotations(toss.orientation[0])
    w_WB = R_WB.apply(toss.angular_velocity[0])
    plant.SetPositions(context, np.r_[R_WB.as_quat(scalar_first=True), toss.position[0]])
    plant.SetVelocities(context, np.r_[w_WB, toss.velocity[0]])
    impulse, results, step = (
        np.zeros(2),
        plant.get_contact_results_output_port(),
        plant.time_step(),
    )

    def add_up(at: Context) -> EventStatus:
        found = results.Eval(plant.GetMyContextFromRoot(at))
        for k in range(found.num_point_pair_contacts()):
            force = found.point_pair_contact_info(k).contact_force()
            impulse[:] += step * abs(force[2]), step * np.hypot(force[0], force[1])
        return EventStatus.DidNothing()

    simulator, rows = Simulator(diagram, root), [plant.GetPositions(context)]
    simulator.Initialize()
    simulator.set_monitor(add_up)
    for k in range(1, len(toss.position)):
        # The step of a time is done when it is reached: the nearest state is one of half before.
        simulator.AdvanceTo(k / cube.CUBE_RATE - step / 2)
        rows.append(plant.GetPositions(context))
    quaternion, position = np.split(np.array(rows), [4], axis=1)
    return Flight(quaternion, position, *impulse.tolist())
