import numpy as np
import pytest

from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.systems.cameras.camera_image import add_noise
from chamfer.systems.vision.part_detector import measurement_spread


def test_what_was_measured_of_the_papers_parts() -> None:
    found = measurement_spread(4.0, peg=116, hole=80, gap=60)
    assert found.lateral == pytest.approx(0.026, rel=0.1)
    assert found.rotational == pytest.approx(2.5e-4, rel=0.2)


def test_drawn_pictures_spread_as_the_law_says() -> None:
    scenario = resolve(AlignmentScenario())
    random = np.random.default_rng(0)
    look = StillVision(scenario, lambda image: add_noise(image, 8.0, random))
    poses = scenario.nominal_pose("peg"), scenario.nominal_pose("hole")
    errors = np.array([look.error(*poses) for _ in range(12)])
    spread = np.sqrt(errors[:, [1, 2, 4, 5]].var(axis=0, ddof=1).reshape(2, 2).mean(axis=1))
    law = measurement_spread(8.0, peg=116, hole=80, gap=60)
    pixel = scenario.cameras.pixel_size
    assert spread[0] == pytest.approx(pixel * law.lateral, rel=0.4)
    assert spread[1] == pytest.approx(law.rotational, rel=0.4)


def test_short_edges_and_long_gaps_are_measured_less_surely() -> None:
    usual = measurement_spread(4.0, peg=100, hole=100, gap=50)
    assert measurement_spread(4.0, peg=50, hole=50, gap=25).rotational == pytest.approx(
        usual.rotational * 2**1.5
    )
    longer = measurement_spread(4.0, peg=100, hole=100, gap=100)
    assert longer.lateral > usual.lateral
    assert longer.rotational == usual.rotational
