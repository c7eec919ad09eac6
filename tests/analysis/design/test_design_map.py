from types import SimpleNamespace

import numpy as np
import pytest

import chamfer.analysis.design.design_map as module
from chamfer.analysis.design.design_map import REFUSED, DesignMap, map_design, parse_map
from chamfer.analysis.design.design_scenario import DesignScenario
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.validation import ParameterError


def assess(scenario: DesignScenario, seed: int, *, draws: int) -> SimpleNamespace:
    """Stand for a theory by which friction and clearance alone decide."""
    parts = scenario.parts
    if parts.friction > 0.55:
        raise ParameterError("parts.friction", parts.friction, "less")
    margin = parts.clearance / 2e-4 - parts.friction
    verdict = "certain" if margin > 0.5 else "likely" if margin > 0 else "no"
    share = min(1.0, max(0.0, margin))
    return SimpleNamespace(verdict=verdict, limiting_link="wedging", margin=margin, share=share)


def mapped(monkeypatch: pytest.MonkeyPatch, points: int) -> DesignMap:
    monkeypatch.setattr(module, "assess", assess)
    monkeypatch.setattr(module, "resolve_design", lambda scenario: scenario)
    scenario = DesignScenario()
    radius = scenario.parts.hole_radius
    texts = ["parts.friction:0.1:0.6", f"parts.peg_radius:{radius - 2e-4}:{radius - 2.5e-5}"]
    return map_design(scenario, parse_map(scenario, texts, points), 0, lambda *_: None)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> DesignMap:
    return mapped(monkeypatch, 6)


def test_borders_are_those_of_a_map_that_is_computed_everywhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    coarse_first = mapped(monkeypatch, 25)
    monkeypatch.setattr(module, "_STRIDES", (1,))
    everywhere = mapped(monkeypatch, 25)
    assert everywhere.computed.all()
    assert coarse_first.computed.mean() < 0.75
    np.testing.assert_array_equal(coarse_first.verdict, everywhere.verdict)
    np.testing.assert_allclose(coarse_first.margin, everywhere.margin, atol=1e-12)
    np.testing.assert_array_equal(
        coarse_first.limiting[coarse_first.verdict != REFUSED],
        everywhere.limiting[everywhere.verdict != REFUSED],
    )


def test_between_infinite_margins_there_is_none_that_is_finite() -> None:
    between = module._bilinear(np.array([[-np.inf, 1.0], [-np.inf, 3.0]]))
    assert between[:, 2].tolist() == [1.0, 2.0, 3.0]
    assert np.isneginf(between[:, :2]).all()


def test_first_field_is_to_the_right_and_the_second_one_up(found: DesignMap) -> None:
    assert found.verdict.shape == (6, 6)
    assert found.verdict[0, 0] == "certain"  # little friction, much clearance
    assert found.verdict[-1, 3] == "no"
    assert found.verdict[3, 3] == "likely"
    table = found.table()
    clearance = DesignScenario().parts.hole_radius - table["parts.peg_radius"]
    known = np.isfinite(table["margin"])
    margin = clearance / 2e-4 - table["parts.friction"]
    assert table["margin"][known] == pytest.approx(margin[known])


def test_points_without_a_design_say_why_and_the_others_go_on(found: DesignMap) -> None:
    refused = found.verdict == REFUSED
    assert refused[:, -1].all()
    assert refused.sum() == 6
    assert "parts.friction is 0.6, allowed: less" in found.limiting[0, -1]
    assert np.isnan(found.margin[refused]).all()


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["parts.friction:0.1"], "PATH:a:b"),
        (["parts.friction:0.6:0.1"], "the lower end first"),
        (["parts.friction:0.1:0.6"], "has 1 fields"),
        (["parts.friction:0.1:0.6"] * 2, "twice"),
        (["parts.frictoin:0.1:0.6", "gap:0:1"], "no field begins with 'parts.frictoin'"),
        (["parts:0.1:0.6"], "several fields"),
        (["cameras.renderer:0.1:0.6"], "no number"),
    ],
)
def test_mistakes_are_one_line(texts: list[str], message: str) -> None:
    with pytest.raises(UserError, match=message) as error:
        parse_map(DesignScenario(), texts, 41)
    assert "\n" not in str(error.value)


def test_whole_numbers_stay_whole_and_the_design_is_marked() -> None:
    texts = ["cameras.width:160:170", "parts.clearance:1e-4:3e-4"]
    x, y = parse_map(DesignScenario(), texts, 41)
    assert x.values == tuple(map(float, range(160, 171)))
    assert x.here == DesignScenario().cameras.width
    # That of several fields which change together.
    assert (y.unit, y.here) == ("m", pytest.approx(DesignScenario().parts.clearance))


def test_any_number_of_the_scenario_may_be_an_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = DesignScenario()
    wide = module._with(scenario, "cameras.width", 400.0)
    assert wide.cameras.width == 400
    assert isinstance(wide.cameras.width, int)
    assert module._with(scenario, "decide.margin", 0.2).decide.margin == 0.2
    tight = module._with(scenario, "parts.clearance", 1e-4)
    assert tight.parts.clearance == pytest.approx(1e-4)
