"""A user's own controllers in the work cell, instead of the compensator and of an arm's law."""

from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.alignment import make_alignment_diagram, resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.insertion.insertion import InsertionScenario, make_insertion_diagram
from chamfer.diagrams.insertion.insertion import resolve as resolve_insertion
from chamfer.models.validation import ParameterError
from chamfer.systems.force.impedance_controller import ImpedanceController

PERIOD = 1 / 80
SHORT = resolve(AlignmentScenario(begin=0.2, compensation_time=1.0))


class Integrator(LeafSystem):
    """Integrates the measured error wherever it is measured."""

    def __init__(self, size: int = 6) -> None:
        super().__init__()
        self._error = self.DeclareVectorInputPort("error", 6)
        self._valid = self.DeclareVectorInputPort("valid", 1)
        state = self.DeclareDiscreteState(size)
        self.DeclareStateOutputPort("compensation", state)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._tick)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        gain = 0.06 * np.array([5e-4] * 3 + [1.0] * 3) * self._valid.Eval(context)[0]
        total = context.get_discrete_state_vector().value()
        values.set_value(total + gain * np.nan_to_num(self._error.Eval(context)))


def test_an_own_controller_aligns_the_parts() -> None:
    diagram = make_alignment_diagram(SHORT, controller=Integrator())
    found = simulate(diagram, duration=SHORT.duration, step=PERIOD, seed=0).outputs
    off = np.hypot(found["error"][:, 1], found["error"][:, 2])
    assert not found["compensation"][10].any()
    assert off[-1] < 0.2 * off[20]


def test_an_own_law_drives_an_arm() -> None:
    arm, posture = SHORT.peg.known_arm(), SHORT.rest_posture("peg")
    own = ImpedanceController(arm, posture, SHORT.impedance)
    runs = [
        simulate(
            make_alignment_diagram(SHORT, arm_controllers=given), duration=0.1, step=PERIOD, seed=0
        ).outputs["peg.true_pose"]
        for given in (None, {"peg": own})
    ]
    np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"controller": Integrator(5)},
            r"output port compensation of size 6; .*compensation \(5\)",
        ),
        ({"controller": ConstantVectorSource([0.0] * 6)}, "input port error of size 6; .* none"),
        (
            {"arm_controllers": {"hole": Integrator()}},
            r"^hole controller is .*input port encoders of size 14; .*error \(6\), valid \(1\)",
        ),
    ],
)
def test_other_ports_are_refused_in_a_line(given: dict[str, Any], told: str) -> None:
    for make, scenario in (
        (make_alignment_diagram, SHORT),
        (make_insertion_diagram, resolve_insertion(InsertionScenario())),
    ):
        with pytest.raises(ParameterError, match=told) as refused:
            make(scenario, **given)  # type: ignore[operator]
        assert "\n" not in str(refused.value)
