"""The peg's mass strikes a plate: over steps, dissipations and approximations, against theory."""

from dataclasses import replace
from itertools import product
from typing import Final, get_args

import numpy as np
from matplotlib.figure import Figure
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.drawing.figure_style import PUBLISHED, dress, legend_below, new_figure
from chamfer.analysis.scenario.experiment import Metric, Table, column
from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario
from chamfer.models.peg.bore_contact import point_contact
from chamfer.systems.contact.contact_approximation import Approximation, approximate

_KINDS: Final = get_args(Approximation)
_RADIUS: Final = 0.01  # m, of the body
_LOOKS: Final = ("o", "#1b4f9c"), ("s", "#e07b00"), ("^", "#1b7f5c"), ("x", "#8f5bb5")
# Shares of the scenario's step and dissipation.
_VARIED: Final = ((1.0, 1.0), (0.5, 1.0), (0.1, 1.0), (0.01, 1.0), (1.0, 0.25), (1.0, 0.0))
_ALONG: Final = 10.0  # times the speed across the plate: so that no friction stops the body
_MOST: Final = 100_000  # steps, of an impact


def strike(
    scenario: PegInsertionScenario, speed: float, approximation: Approximation
) -> tuple[float, float]:
    """Let a body strike with a speed, m/s, across the plate and ten times that along it.

    No gravity acts. It begins half a step's way off, and ends where it has come off the plate.
    Return its rebound in shares of the speed, and what friction took over mu times the normal
    impulse: 1 by Coulomb.
    """
    builder, step = DiagramBuilder(), scenario.step
    plant, _ = AddMultibodyPlantSceneGraph(builder, step)
    approximate(plant, approximation)
    plant.set_stiction_tolerance(scenario.stiction)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    turns_not = UnitInertia.SolidSphere(1e3)
    body = plant.AddRigidBody("body", SpatialInertia(scenario.mass, np.zeros(3), turns_not))
    contact, mu = scenario.contact, scenario.parts.friction
    touch = point_contact(contact.stiffness, contact.dissipation, mu)
    add, below = plant.RegisterCollisionGeometry, RigidTransform([0.0, 0.0, -0.5])
    add(body, RigidTransform(), Sphere(_RADIUS), "body", touch)
    add(plant.world_body(), below, Box(1.0, 1.0, 1.0), "plate", touch)
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, body, RigidTransform([0, 0, _RADIUS + speed * step / 2]))
    plant.SetVelocities(context, [0, 0, 0, _ALONG * speed, 0, -speed])
    for k in range(2, _MOST):
        simulator.AdvanceTo(k * step)
        if plant.GetPositions(context)[-1] >= _RADIUS:
            break
    along, _, across = plant.GetVelocities(context)[-3:].tolist()
    return across / speed, (_ALONG * speed - along) / (mu * (speed + across))


def strike_all(scenario: PegInsertionScenario, speed: float) -> Table:
    """Return a row an impact: of every approximation the scenario's own, and those varied."""
    rows = []
    for kind, (finer, less) in product(_KINDS, _VARIED):
        step, d = scenario.step * finer, scenario.contact.dissipation * less
        contact = replace(scenario.contact, dissipation=d)
        found = strike(replace(scenario, step=step, contact=contact), speed, kind)
        rows.append((_KINDS.index(kind), step, d, contact.restitution(speed), *found))
    names = "approximation", "step", "dissipation", "predicted", "rebound", "friction"
    return {name: column(list(of)) for name, of in zip(names, np.transpose(rows), strict=True)}


def impact_metrics(table: Table) -> dict[str, Metric]:
    """Return the results of an impact with the scenario's own step, and those of theory."""
    said = {"predicted.rebound": (float(table["predicted"][0]), "", "of its speed")}
    for k, name in enumerate(_KINDS):
        row = k * len(_VARIED)
        said[f"{name}.rebound"] = (float(table["rebound"][row]), "", "of its speed")
        said[f"{name}.friction"] = (float(table["friction"][row]), "", "of Coulomb's")
    return metrics_of(said)


def draw_impacts(table: Table) -> Figure:
    """Draw friction and rebound of every impact."""
    figure = new_figure(
        height=4.2,
        caption="Friction and rebound of a body in oblique impact, by each way to integrate the "
        "contact, beside theory, over step and dissipation.",
    )
    count = len(_VARIED)
    pairs = zip(table["step"][:count], table["dissipation"][:count], strict=True)
    names = [f"{step:g}\n{d:g}" for step, d in pairs]
    theory = {
        "friction / Coulomb's": np.ones(count),
        "rebound / speed": table["predicted"][:count],
    }
    for axes, (of, said) in zip(figure.subplots(1, 2), theory.items(), strict=True):
        values = table[of.partition(" ")[0]].reshape(-1, count)
        axes.plot(names, said, label="theory", **PUBLISHED)
        for name, look, y in zip(_KINDS, _LOOKS, values, strict=True):
            axes.plot(names, y, look[0], color=look[1], label=name)
        title = "(a) Friction" if of.startswith("friction") else "(b) Rebound"
        dress(axes, title=title, x="step / s, dissipation / (s/m)", y=of)
    legend_below(figure, figure.axes[0], columns=5)
    return figure
