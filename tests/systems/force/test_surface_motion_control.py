"""The task along a surface and the hybrid controller together: section 5.3."""

from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, LinearSystem

from chamfer.models.arms.cartesian_manipulator import (
    CartesianManipulatorParams,
    cartesian_kinematics,
)
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.force.hybrid_controller import HybridController, HybridControllerParams
from chamfer.systems.force.surface_motion import SurfaceMotion, SurfaceMotionParams

CONTACT = [1.0]


def controller(dimension: int, **changes: Any) -> HybridController:
    zero = (0.0,) * dimension
    params = HybridControllerParams(
        **{
            "law": "transpose",
            "stiffness": (100.0, 120.0, 80.0)[:dimension],
            "integral": zero,
            "damping": zero,
            "force_integral": 1.5,
            "feedforward_torque": (),
            "bumpless": False,  # or the first torque in contact would be 0, and the rest off by it
            **changes,
        }
    )
    return HybridController(cartesian_kinematics(dimension), params)


def connect(builder: DiagramBuilder, motion: SurfaceMotion, hybrid: HybridController) -> None:
    for name in ("selection", "desired_force", "desired_position"):
        builder.Connect(motion.GetOutputPort(name), hybrid.GetInputPort(name))


def open_loop(dimension: int, motion: SurfaceMotion, motion_first: bool) -> Diagram:
    """Return both blocks with inputs ``encoders``, ``normal`` and ``measured_force``."""
    builder = DiagramBuilder()
    hybrid = controller(dimension)
    for block in (motion, hybrid) if motion_first else (hybrid, motion):
        builder.AddSystem(block)
    mode = builder.AddSystem(ConstantVectorSource(CONTACT))
    connect(builder, motion, hybrid)
    builder.Connect(mode.get_output_port(), hybrid.GetInputPort("mode"))
    builder.ExportInput(hybrid.GetInputPort("encoders"), "encoders")
    builder.ConnectInput("encoders", motion.GetInputPort("endpoint_motion"))
    builder.ExportInput(motion.GetInputPort("normal"), "normal")
    builder.ExportInput(hybrid.GetInputPort("measured_force"), "measured_force")
    builder.ExportOutput(hybrid.GetOutputPort("torque"), "torque")
    return builder.Build()


@pytest.mark.parametrize("motion_first", [True, False])
@pytest.mark.parametrize("dimension", [2, 3])
def test_effort_is_the_section_s_formula(dimension: int, motion_first: bool) -> None:
    rng = np.random.default_rng(dimension)
    start = (0.0, -0.1, 0.2)[:dimension]
    motion = SurfaceMotion(SurfaceMotionParams(), start=start, period=0.005)
    diagram = open_loop(dimension, motion, motion_first)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    T, Vd, Fd, Kif = 0.005, 0.5, 5.0, 1.5
    Kp = np.array([100.0, 120.0, 80.0])[:dimension]
    x_d, If = np.array(start), np.zeros(dimension)
    for tick in range(30):
        x = np.array(start) + 0.02 * tick + 0.01 * rng.normal(size=dimension)
        n = rng.normal(size=dimension)
        n /= np.linalg.norm(n)
        pushed = 5 * rng.normal(size=dimension)  # by the surface
        for name, value in (
            ("encoders", [*x, *rng.normal(size=dimension)]),
            ("normal", n),
            ("measured_force", -pushed),
        ):
            diagram.GetInputPort(name).FixValue(context, value)
        simulator.AdvanceTo(tick * T)
        simulator.AdvancePendingEvents()
        F = np.outer(n, n)
        P = np.eye(dimension) - F
        across = np.cross([*n, 0.0][:3], [0, 0, 1])[:dimension]
        ep = P @ (x_d + Vd * T * across / np.linalg.norm(across) - x)
        x_d = x + ep
        If = If + Kif * F @ (-Fd * n + pushed) * T
        u = Kp * ep - Fd * n + If
        found = diagram.GetOutputPort("torque").Eval(context)
        np.testing.assert_allclose(found, u, rtol=0, atol=1e-12)


@pytest.mark.parametrize("speed", [0.5, -0.3])
def test_slides_along_an_elastic_plane(speed: float) -> None:
    """The arm of (5-7) on a slope without friction, all at its start as in section 5.3.4."""
    n = np.array([0.6, 0.8])
    along = np.array([0.8, -0.6])
    start = tuple(-0.1 * n)  # 10 N with 100 N/m
    builder = DiagramBuilder()
    arm = builder.AddSystem(
        make_cartesian_manipulator(CartesianManipulatorParams(), start=start, step=0.001)
    )
    params = SurfaceMotionParams(speed=speed)
    motion = builder.AddSystem(SurfaceMotion(params, start=start, period=0.005))
    hybrid = builder.AddSystem(controller(2, stiffness=(100.0, 100.0), force_integral=1.0))
    stiffness = 100 * np.hstack([np.outer(n, n), np.zeros((2, 2))])
    surface = builder.AddSystem(LinearSystem(D=-stiffness))
    sensor = builder.AddSystem(LinearSystem(D=stiffness))
    total = builder.AddSystem(Adder(2, 2))
    connect(builder, motion, hybrid)
    encoders = arm.get_output_port()
    for port in (
        motion.GetInputPort("endpoint_motion"),
        hybrid.GetInputPort("encoders"),
        surface.get_input_port(),
        sensor.get_input_port(),
    ):
        builder.Connect(encoders, port)
    builder.Connect(sensor.get_output_port(), hybrid.GetInputPort("measured_force"))
    for value, port in (
        (n, motion.GetInputPort("normal")),
        (CONTACT, hybrid.GetInputPort("mode")),
    ):
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), port)
    builder.Connect(hybrid.GetOutputPort("torque"), total.get_input_port(0))
    builder.Connect(surface.get_output_port(), total.get_input_port(1))
    builder.Connect(total.get_output_port(), arm.get_input_port())
    simulator = Simulator(builder.Build())
    context = simulator.get_context()
    simulator.AdvanceTo(10.0)
    x, v = np.split(encoders.Eval(arm.GetMyContextFromRoot(context)), 2)
    assert -100 * n @ x == pytest.approx(5.0, abs=1e-3)
    np.testing.assert_allclose(v, speed * along, rtol=0, atol=1e-6)
    # The damping is overcome by a position error: b V_d / K_p.
    error = hybrid.GetOutputPort("position_error").Eval(hybrid.GetMyContextFromRoot(context))
    lag = 10.0 * speed / 100
    assert along @ error == pytest.approx(lag, rel=0.02)
    assert along @ x == pytest.approx(10.0 * speed - lag, abs=0.01)
