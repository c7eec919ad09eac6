import math

import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue
from chamfer.analysis.sweep.sweep import sweep


def test_table_has_a_row_for_each_point(toys: Catalogue) -> None:
    table = sweep("fall", {"body.mass": [1, 2], "height": [3.0, 4.5]}, catalogue=toys)
    assert list(table) == [
        *("body.mass", "height", "end", "measured.height", "overflow", "undefined"),
        *("broken", "status", "seed"),
    ]
    assert table["body.mass"].tolist() == [1, 1, 2, 2]
    assert table["height"].tolist() == [3.0, 4.5, 3.0, 4.5]
    assert table["measured.height"].tolist() == [3.0, 4.5, 3.0, 4.5]
    assert np.isnan(table["overflow"]).all()
    assert table["status"].tolist() == ["ok"] * 4
    assert table.units["body.mass"] == "kg"
    assert table.units["end"] == "m"


def test_refused_and_failing_points_are_rows_and_the_others_go_on(toys: Catalogue) -> None:
    table = sweep("fall", {"height": [1.0, 200.0, 13.0, 2.0]}, metrics=["end"], catalogue=toys)
    assert table["status"].tolist() == [
        "ok",
        "height is 200.0, allowed: a number <= 100",  # by resolving
        "height is 13.0, allowed: a lucky number",  # by the run
        "ok",
    ]
    assert np.isnan(table["end"]).tolist() == [False, True, True, False]
    wrong = sweep("fall", {"body.mass": [-1, "x"]}, metrics=["end"], catalogue=toys)
    assert [text.partition(",")[0] for text in wrong["status"]] == [
        "body.mass is -1.0",
        "body.mass is 'x'",
    ]
    (failed,) = sweep("broken", {"noise": [1.0]}, catalogue=toys)["status"]
    assert failed.startswith("ZeroDivisionError: by zero (all.py, line ")
    (stopped,) = sweep("asserting", {"noise": [1.0]}, catalogue=toys)["status"]
    assert stopped.startswith("stopped by Drake: Failure at plant.cc:1")


def test_trials_are_means_with_intervals_over_seeds(toys: Catalogue) -> None:
    def end(seed: int) -> float:
        return float(sweep("fall", {"height": [5.0]}, seed=seed, catalogue=toys)["end"][0])

    table = sweep("fall", {"height": [5.0, 6.0]}, trials=3, seed=4, catalogue=toys)
    ends = np.array([end(seed) for seed in (4, 5, 6)])
    assert table["end"][0] == pytest.approx(ends.mean())
    # Student's t for two degrees of freedom.
    assert table["end.ci95"][0] == pytest.approx(4.302653 * ends.std(ddof=1) / math.sqrt(3))
    assert table["seed"].tolist() == [4, 4]
    assert len(table["status"]) == 2


def test_rest_of_the_scenario_is_what_is_set(toys: Catalogue) -> None:
    table = sweep("fall", {"body.mass": [1, 2]}, settings=["height=7"], catalogue=toys)
    assert table["height"].tolist() == [7.0, 7.0]
    with pytest.raises(UserError, match=r"body.mass is set and body.mass is varied"):
        sweep("fall", {"body.mass": [1, 2]}, settings=["body.mass=7"], catalogue=toys)


def test_unknown_names_are_answered_by_valid_ones(toys: Catalogue) -> None:
    with pytest.raises(UserError, match=r"'ends', did you mean 'end'\? valid names: end, height"):
        sweep("fall", {"height": [200.0, 2.0]}, metrics=["ends"], catalogue=toys)
    with pytest.raises(UserError, match="trials is 0"):
        sweep("fall", {"height": [2.0]}, trials=0, catalogue=toys)
