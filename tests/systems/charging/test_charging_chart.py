"""The charging cycle's chart, over an ideal arm in a scripted cell."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from chamfer.models.charging.packing import ItemKind, PlanItem

Cells = Callable[..., Any]

ACQUIRE = ["acquire.above", "acquire.zero", "acquire.descend", "acquire.touch", "acquire.grip"]
CARRY = {
    "wall": ["scan.run_in", "scan.pass", "slew.over", "wall.lower", "wall.zero", "wall.approach"],
    "crown": ["scan.run_in", "scan.pass", "slew.over", "crown.lower", "crown.zero"],
    "bulk": ["slew.over", "bulk.lower", "bulk.pour"],
}
LAY = {
    "wall": ["wall.seek", "wall.press", "wall.slide", "wall.land", "wall.touch", "wall.set_down"],
    "crown": ["crown.descend", "crown.land", "crown.set_down"],
    "bulk": [],
}


@pytest.mark.parametrize("kind", ["wall", "crown", "bulk"])
def test_an_item_goes_through_its_modes(cell_with: Cells, kind: ItemKind) -> None:
    cell = cell_with([PlanItem(kind=kind)]).end()
    opened = [] if kind == "bulk" else ["release.open"]
    assert [record.target for record in cell.records] == [
        "home.settle",
        *ACQUIRE,
        "acquire.lift",
        "acquire.weigh",
        *CARRY[kind],
        *LAY[kind],
        *opened,
        "retreat.up",
        "return.over",
        "done",
    ]
    assert cell.memory.said() == ""


def test_from_everywhere_the_cycle_can_be_stopped_and_ended(cell_with: Cells) -> None:
    chart = cell_with([PlanItem()]).chart
    stopping = {"back_off.brake", "back_off.away"}
    for state in chart.states:
        if state.outcome is None:
            ways = chart.reachable(state.name)
            assert "stopped" in ways
            assert state.name in stopping or {"done", "halted"} <= ways


def test_items_follow_one_another(cell_with: Cells) -> None:
    cell = cell_with([PlanItem(), PlanItem(kind="crown", azimuth=0.5), PlanItem(kind="bulk")])
    seen = []
    while cell.state != "done":
        cell.tick()
        if cell.state in ("wall.set_down", "crown.set_down", "bulk.pour"):
            seen.append((cell.state, cell.memory.item))
    assert list(dict.fromkeys(seen)) == [
        ("wall.set_down", 0),
        ("crown.set_down", 1),
        ("bulk.pour", 2),
    ]


def test_a_turned_place_is_approached_along_its_normal(cell_with: Cells) -> None:
    cell = cell_with([PlanItem(azimuth=0.7)]).to("wall.seek")
    begin = np.array(cell.commands[-1])
    cell.to("wall.press")
    way = np.array(cell.commands[-2])[:3] - begin[:3]
    assert way / np.linalg.norm(way) == pytest.approx([math.cos(0.7), math.sin(0.7), 0.0])
    assert begin[3] == pytest.approx(0.7)


def test_noise_alone_is_no_contact(cell_with: Cells) -> None:
    # As many readings in a row as detection asks for, less one, over and over.
    cell = cell_with([PlanItem()]).to("acquire.descend")
    readings = 0
    while cell.state == "acquire.descend" and cell.commands[-1][2] > 0.42:
        readings += 1
        cell.faults.extra_force = (0.0, 0.0, -3.0 if readings % 3 else 0.0)
        cell.tick()
    assert cell.state == "acquire.descend"
    assert readings > 20
