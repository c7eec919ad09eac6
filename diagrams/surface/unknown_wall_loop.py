"""An arm that finds an unknown wall: Fig. 2-4 and Fig. 5-7 in one loop (section 6.3)."""

from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from chamfer.diagrams.contact.hybrid_loop import (
    add_friction_compensation,
    add_kick,
    add_manipulator,
)
from chamfer.diagrams.surface.unknown_wall_scenario import UnknownWallScenario, resolve_wall
from chamfer.systems.estimation.settled_force import SettledForce
from chamfer.systems.estimation.surface_observer import SurfaceObserver
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.surface_motion import GuardedMotion, SurfaceMotion
from chamfer.systems.sensing.encoders import EndpointMotion
from chamfer.systems.sensing.force_rate import ForceRate

SIGNALS: Final = (
    "encoders",
    "contact_force",
    "contact",
    "tip",
    "torque",
    "position_error",
    "force_error",
    "mode",
    "normal",
    "covariance",
    "deviation",
    "status",
    "measured_force",
    "measured_force_rate",
    "nominal_motion",
)


def make_unknown_wall_diagram(scenario: UnknownWallScenario) -> Diagram:
    """Build the loop; it exports :data:`SIGNALS`.

    Controller and observer know the arm by its encoders and its force sensor alone. Before contact
    the arm follows the guarded approach; in contact the observer's normal makes selection, desired
    force and motion; lost contact is sought along the last normal.

    Raises:
        ParameterError: As :func:`chamfer.diagrams.surface.unknown_wall_scenario.resolve_wall`.
    """
    scenario = resolve_wall(scenario)
    arm, task, control = scenario.ARM, scenario.task, scenario.controller
    d, m = scenario.dimension, scenario.ARM.num_coordinates
    builder = DiagramBuilder()
    manipulator = add_manipulator(builder, scenario)
    add = builder.AddNamedSystem
    endpoint = add("endpoint motion", EndpointMotion(arm, dimension=d))
    spatial = add("force in space", MatrixGain(np.eye(d, m)))
    rate = add("force rate", ForceRate(scenario.force_rate, dimension=d, period=control.period))
    settled = add("settled force", SettledForce(task.wait, dimension=d, period=control.period))
    observer = add(
        "surface estimator", SurfaceObserver(scenario.observer, scenario.spatial_up[:d])
    )
    detection = add(
        "contact detection",
        ContactDetection(scenario.detection, scenario.direction, period=control.period),
    )
    approach = add("approach", GuardedMotion(task))
    motion = add(
        "task",
        SurfaceMotion(
            task.motion,
            start=task.start,
            axis=scenario.axis,
            dimension=d,
            period=control.period,
        ),
    )
    controller = add(
        "hybrid control",
        HybridController(
            arm, control, dynamics=scenario.dynamics() if control.full_dynamics else None
        ),
    )
    connect = builder.Connect
    measured = manipulator.measured_force
    mode = detection.GetOutputPort("state")
    connect(manipulator.encoders, endpoint.get_input_port())
    connect(measured, spatial.get_input_port())
    connect(spatial.get_output_port(), rate.get_input_port())
    for name, source in (("force", spatial), ("force_rate", rate)):
        connect(source.get_output_port(), settled.GetInputPort(f"measured_{name}"))
        connect(
            settled.GetOutputPort(f"settled_{name}"), observer.GetInputPort(f"measured_{name}")
        )
    connect(mode, settled.GetInputPort("mode"))
    connect(endpoint.GetOutputPort("nominal_motion"), observer.GetInputPort("nominal_motion"))
    connect(measured, detection.GetInputPort("measured_force"))
    connect(detection.GetOutputPort("contact_time"), approach.GetInputPort("contact_time"))
    connect(endpoint.GetOutputPort("endpoint_motion"), motion.GetInputPort("endpoint_motion"))
    connect(observer.GetOutputPort("normal"), motion.GetInputPort("normal"))
    connect(mode, motion.GetInputPort("mode"))
    connect(approach.get_output_port(), motion.GetInputPort("approach"))
    connect(manipulator.encoders, controller.GetInputPort("encoders"))
    connect(measured, controller.GetInputPort("measured_force"))
    connect(mode, controller.GetInputPort("mode"))
    for name in ("selection", "desired_force", "desired_position"):
        connect(motion.GetOutputPort(name), controller.GetInputPort(name))
    torque = add_friction_compensation(builder, scenario, manipulator, controller)
    connect(torque, manipulator.torque)
    add_kick(builder, scenario, manipulator.arm)
    for name in ("encoders", "contact_force", "contact", "tip"):
        builder.ExportOutput(manipulator.arm.GetOutputPort(name), name)
    for name in ("torque", "position_error", "force_error"):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    for name in ("normal", "covariance", "deviation", "status"):
        builder.ExportOutput(observer.GetOutputPort(name), name)
    builder.ExportOutput(mode, "mode")
    builder.ExportOutput(spatial.get_output_port(), "measured_force")
    builder.ExportOutput(rate.get_output_port(), "measured_force_rate")
    builder.ExportOutput(endpoint.GetOutputPort("nominal_motion"), "nominal_motion")
    diagram = builder.Build()
    diagram.set_name(f"Control along an unknown wall, {arm.name}")
    return diagram
