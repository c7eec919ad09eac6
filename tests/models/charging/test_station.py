"""The surfaces of the charging cell."""

import math

import numpy as np
import pytest

from chamfer.models.charging.station import Station
from chamfer.models.surfaces.surface import locate

STATION = Station()


def at(azimuth: float, radius: float, height: float) -> np.ndarray:
    return np.array([*STATION.place(azimuth, radius), height])


def test_wall_is_material_below_the_rim_alone() -> None:
    wall = STATION.wall()
    inner = STATION.crucible_radius
    low = STATION.rim_height - 0.02
    assert locate(wall, at(0.4, inner - 0.01, low)).gap == pytest.approx(0.01)
    assert locate(wall, at(0.4, inner + 0.001, low)).gap == pytest.approx(-0.001)
    assert locate(wall, at(0.4, inner + 0.004, low + 0.05)).gap == pytest.approx(0.03)
    assert locate(wall, np.array(STATION.feeder)).gap > 0.1


def test_leaning_wall_recedes_upwards() -> None:
    leaning = STATION.wall(lean=0.1)
    height = STATION.bed_height + 0.05
    gap = locate(leaning, at(0.0, STATION.crucible_radius, height)).gap
    inner = STATION.crucible_radius
    expected = 0.05 * math.sin(0.1) + inner * (1 - math.cos(0.1))
    assert gap == pytest.approx(expected, rel=1e-9)


def test_layer_and_tray_end_where_they_do() -> None:
    layer = STATION.layer(STATION.crucible_centre, 0.4, tilt=0.05)
    assert layer.level(at(0.0, 0.1, 0.4)) == pytest.approx(-0.1 * math.tan(0.05))
    assert locate(layer, np.array(STATION.feeder)).gap > 0.1
    tray = STATION.tray(0.04)
    assert tray.level(np.array(STATION.feeder)) == pytest.approx(-0.04)
    assert locate(tray, at(0.0, 0.0, 0.36)).gap > 0.1
