"""The charging cycle's chart, over an ideal arm in a scripted cell."""

from collections.abc import Callable

import pytest

from models.charging.packing import Kind, PlanItem

Cells = Callable[..., "Cell"]  # type: ignore[name-defined] # noqa: F821

ACQUIRE = ["acquire.above", "acquire.zero", "acquire.descend", "acquire.touch", "acquire.grip"]
CARRY = {
    "wall": ["scan.run_in", "scan.pass", "slew.over", "wall.lower", "wall.zero", "wall.approach"],
    "crown": ["scan.run_in", "scan.pass", "slew.over", "crown.lower", "crown.zero"],
    "bulk": ["slew.over", "bulk.lower", "bulk.pour"],
}
LAY = {
    "wall": ["wall.seek", "wall.slide", "wall.land", "wall.touch", "wall.set_down"],
    "crown": ["crown.descend", "crown.land", "crown.set_down"],
    "bulk": [],
}


@pytest.mark.parametrize("kind", ["wall", "crown", "bulk"])
def test_an_item_goes_through_its_modes(cell_with: Cells, kind: Kind) -> None:
    cell = cell_with([PlanItem(kind=kind)]).end()
    opened = [] if kind == "bulk" else ["release.open"]
    assert [record.target for record in cell.records] == [
        "home.settle",
        *ACQUIRE,
        "acquire.lift",
        *CARRY[kind],
        *LAY[kind],
        *opened,
        "retreat.up",
        "return.over",
        "done",
    ]
    assert cell.memory.said() == ""
