"""What was identified is a scenario that run and design take, and each value of it counts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
from chamfer.analysis.identify.identified_scenario import fragment_text
from chamfer.analysis.identify.quantity import Quantity, unknown
from chamfer.analysis.report.results import nested_values
from chamfer.analysis.scenario.scenario_io import make_scenario, unstructure
from chamfer.analysis.scenario.scenario_yaml import read_mapping
from chamfer.diagrams.insertion.insertion import InsertionScenario, resolve

CELLS = ("wam-pair", "ur5e-fixture", "scara-rcc")
JOINTS = [
    f"joint_friction.{kind}_{side}.{i}"
    for kind in ("coulomb", "viscous")
    for side in ("plus", "minus")
    for i in range(1, 8)
]


def told(**changed: float) -> dict[str, Quantity]:
    """Return quantities as a log tells them."""
    values = {"friction": 0.21, "tool.mass": 0.8, "sensor.noise": 0.06, "delay": 0.02}
    values |= {f"stiffness.{axis}": 500.0 + 50 * i for i, axis in enumerate("xyz")}
    values |= {f"sensor.offset.{axis}": 0.3 + i for i, axis in enumerate("xyz")}
    values |= {name: 0.2 + 0.01 * i for i, name in enumerate(JOINTS)} | changed
    found = {name: Quantity(one, 0.9 * one, 1.1 * one, "s") for name, one in values.items()}
    return found | {"damping.x": unknown("N s/m", "too little motion")}


def resolved(given: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return all values that run and design come to, by their fields."""
    run = resolve(make_scenario(InsertionScenario(), given=given))
    design = resolve_design(make_scenario(DesignScenario(), given=given))
    return [dict(nested_values(unstructure(one))) for one in (run, design)]


@pytest.mark.parametrize("cell", CELLS)
def test_run_and_design_take_it_and_each_value_changes_theirs(cell: str, tmp_path: Path) -> None:
    path = tmp_path / "identified.yaml"
    path.write_text(fragment_text(told(), cell, of="log.npz"))
    given = read_mapping(path)
    fields = {name: value for name, value in nested_values(given) if name != "cell"}
    assert {"parts.friction": 0.21, "peg.tool.mass": 0.8}.items() <= fields.items()
    assert len(fields) == (6 if cell == "wam-pair" else 4)
    if cell == "wam-pair":
        assert fields["peg.joint_friction"][0] == 0.235
        assert fields["peg.friction_asymmetry"][0] == pytest.approx(-0.07 / 0.47, abs=1e-6)
    for found, usual in zip(resolved(given), resolved({"cell": cell}), strict=True):
        for name, value in fields.items():
            assert found[name] == value != usual[name]


@pytest.mark.parametrize("ends", [(10.0, 1e-3, 1e-3), (5e4, 5.0, 2.0)])
def test_the_cell_takes_the_least_and_the_most_and_more_is_left_out(
    ends: tuple[float, float, float], tmp_path: Path
) -> None:
    path = tmp_path / "identified.yaml"
    names = (*(f"stiffness.{axis}" for axis in "xyz"), "tool.mass", "friction")
    values = dict(zip(names, (*ends[:1] * 3, *ends[1:]), strict=True))
    path.write_text(fragment_text(told(**values), "wam-pair", of="log.npz"))
    for found in resolved(read_mapping(path)):
        assert found["impedance.stiffness"] == [ends[0]] * 3
    outside = {name: value * (1.1 if ends[0] > 100 else 0.9) for name, value in values.items()}
    path.write_text(text := fragment_text(told(**outside), "wam-pair", of="log.npz"))
    assert list(read_mapping(path)) == ["peg"]  # the joints' friction
    assert "# Left out, the cell takes 10 to 5e+4: impedance.stiffness: [" in text


def test_what_has_no_field_or_is_not_told_is_a_comment(tmp_path: Path) -> None:
    path = tmp_path / "identified.yaml"
    found = {name: one for name, one in told().items() if name in ("delay", "damping.x")}
    text = fragment_text(found, "wam-pair", of="log.npz")
    path.write_text(text)
    assert read_mapping(path) == {}
    assert "# delay: 0.02 s (0.018 to 0.022)" in text
    assert "# damping.x: unknown; too little motion" in text
    only_z = fragment_text({"stiffness.z": told()["stiffness.z"]}, "wam-pair", of="log.npz")
    assert "stiffness: [400.0, 400.0, 600.0]" in only_z
    assert "400 N/m, the cell's own, where the log gives none" in only_z
