"""Hybrid control along an unknown surface, with the observer in the loop (Fig. 5-7)."""

from dataclasses import replace
from typing import TypeVar

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource

from chamfer.diagrams.surface.surface_scenario import add_observed_contact, told
from chamfer.diagrams.surface.tracking_scenario import TrackingScenario, always_in_contact
from chamfer.diagrams.surface.tracking_stability import require_stable_tracking
from chamfer.models.arms.cartesian_manipulator import cartesian_kinematics
from chamfer.models.validation import ParameterError, within
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.force.contact_detection import CONTACT
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.surface_motion import SurfaceMotion

TrackingScenarioT = TypeVar("TrackingScenarioT", bound=TrackingScenario)


def resolve_tracking(scenario: TrackingScenarioT) -> TrackingScenarioT:
    """Return the scenario with the surface's defaults and the observer's assumptions filled in.

    Raises:
        ParameterError: If a block refuses its parameters, or the loop would be unstable and
            ``controller.allow_unstable`` is not set.
    """
    with within("controller"):
        scenario.controller.for_joints(scenario.dimension)
    level = scenario.surface.make().level(scenario.up * -scenario.task.depth)
    if level > 0:
        raise ParameterError("task.depth", scenario.task.depth, "a start below the surface")
    require_stable_tracking(scenario)
    return replace(
        scenario,
        surface=scenario.surface.resolved(),
        observer=told(scenario),
    )


def make_tracking_diagram(scenario: TrackingScenario) -> Diagram:
    """Return the closed loop of Fig. 5-7.

    Outputs: those of :func:`chamfer.diagrams.surface.surface_estimation.make_estimation_diagram`,
    and the controller's ``effort`` (N), ``position_error`` and ``force_error``.

    Raises:
        ParameterError: As :func:`resolve_tracking`.
    """
    scenario = resolve_tracking(scenario)
    d, period = scenario.dimension, scenario.controller.period
    builder = DiagramBuilder()
    connect = builder.Connect
    manipulator = builder.AddNamedSystem(
        "manipulator dynamics",
        make_cartesian_manipulator(scenario.manipulator, start=scenario.start, step=scenario.step),
    )
    encoders = manipulator.get_output_port()
    contact, force, observer = add_observed_contact(builder, scenario, encoders)
    task = builder.AddNamedSystem(
        "task",
        SurfaceMotion(
            scenario.task,
            start=scenario.start,
            axis=(0.0, 0.0, 1.0) if d == 2 else (0.0, -1.0, 0.0),
            period=period,
        ),
    )
    mode = builder.AddNamedSystem("in contact", ConstantVectorSource([float(CONTACT)]))
    controller = builder.AddNamedSystem(
        "hybrid controller",
        HybridController(cartesian_kinematics(d), always_in_contact(scenario.controller)),
    )
    forces = builder.AddNamedSystem("sum of forces", Adder(2, d))
    connect(encoders, task.GetInputPort("endpoint_motion"))
    connect(observer.GetOutputPort("normal"), task.GetInputPort("normal"))
    connect(encoders, controller.GetInputPort("encoders"))
    for name in ("selection", "desired_force", "desired_position"):
        connect(task.GetOutputPort(name), controller.GetInputPort(name))
    connect(force, controller.GetInputPort("measured_force"))
    connect(mode.get_output_port(), controller.GetInputPort("mode"))
    connect(controller.GetOutputPort("torque"), forces.get_input_port(0))
    connect(contact.GetOutputPort("contact_force"), forces.get_input_port(1))
    connect(forces.get_output_port(), manipulator.get_input_port())
    builder.ExportOutput(controller.GetOutputPort("torque"), "effort")
    for name in ("position_error", "force_error"):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("Control along an unknown surface")
    return diagram
