"""Limits of the task and of parts are judged on scenarios of one's own.

What breaks each of them is in ``published/test_checks_can_fail.py``.
"""

from pathlib import Path
from typing import Final

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.charging.charging_campaign import REMEDIES
from chamfer.analysis.charging.charging_runs import LIMITS
from chamfer.analysis.cli import main
from chamfer.analysis.command.running import prepare
from chamfer.analysis.published.hybrid_force_position_charging import CHARGING, CYCLES
from chamfer.analysis.report.checks import check
from chamfer.analysis.report.results import defined_metrics
from chamfer.analysis.scenario.experiment import quiet, select

NUGGET: Final = ("trials=1", "duration=3", "measure_after=2", "task.speed=0.04", "task.force=3")
WALL: Final = ("trials=1", "duration=3.5", "measure_after=3", "task.kick_time=2.8")
SURFACE: Final = ("trials=2", "duration=2")
FAST: Final = {"contact.losses", "damage.safe_speed_share"}


@pytest.mark.parametrize(
    ("name", "settings", "broken"),
    [
        ("puma-nugget-hold", (), set()),
        ("puma-nugget-hold", ("task.force=8",), {"damage.scratch_time"}),
        ("puma-nugget-hold", ("task.speed=0.3",), FAST),
        ("puma-nugget-hold", ("duration=0.3", "measure_after=0.2"), FAST),  # it never touches
        ("planar-unknown-wall", (), set()),  # what a blow takes off is planned
        ("unknown-surface-control", (), set()),
        ("unknown-surface-control", ("task.force=8",), {"damage.scratch_time"}),
    ],
)
@pytest.mark.filterwarnings("ignore:task.force is")  # the thesis' observer's
def test_one_changed_field_breaks_what_it_should(
    name: str, settings: tuple[str, ...], broken: set[str]
) -> None:
    usual = {
        "puma-nugget-hold": NUGGET,
        "planar-unknown-wall": WALL,
        "unknown-surface-control": SURFACE,
    }[name]
    given = {one.partition("=")[0]: one for one in (*usual, *settings)}
    (job,) = prepare(select(CATALOGUE.entries, [name]), settings=list(given.values()))
    outcome = job.experiment.run(job.scenario, 0, quiet)
    checks = check(job.published, defined_metrics(outcome.metrics), default=not job.overrides)
    assert checks
    assert {one.published.kind for one in checks} == {"specification"}
    assert {one.published.metric for one in checks if not one.ok} == broken


@pytest.mark.slow
@pytest.mark.parametrize(("force", "status"), [(3, 0), (8, 1)])
def test_strict_ends_with_1_where_glass_would_be_scratched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], force: int, status: int
) -> None:
    settings = [word for one in NUGGET[:-1] for word in ("--set", one)]
    command = ["run", "puma-nugget-hold", *settings, "--set", f"task.force={force}"]
    assert main([*command, "--out", str(tmp_path), "--strict"]) == status
    assert f"{3 - status} of 3 specifications kept" in capsys.readouterr().out


def test_limits_of_charging_are_measured_and_each_remedy_has_its_own() -> None:
    assert {one.metric for one in CHARGING} <= set(LIMITS)
    campaign = {one.metric for one in CYCLES if one.experiment == "charging-campaign"}
    assert campaign == {f"{remedy}.cycle.all_limits" for remedy in REMEDIES}
