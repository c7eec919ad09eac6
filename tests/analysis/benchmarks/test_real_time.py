import pytest

from chamfer.analysis.benchmarks.real_time import TARGETS, RealTime, loops, measure
from chamfer.analysis.benchmarks.report import real_time_text


@pytest.mark.slow
def test_factor_is_simulated_over_elapsed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 10.0, 10.5, 20.0, 20.25])  # warming up, then two rounds
    monkeypatch.setattr("chamfer.analysis.benchmarks.real_time.perf_counter", lambda: next(clock))
    found = RealTime()
    loop = loops()["planar-slide"]._replace(duration=0.1)
    measure(found, rounds=2, timed={"planar-slide": loop})
    assert found.factors == {"planar-slide": [pytest.approx(0.2), pytest.approx(0.4)]}
    assert found.median("planar-slide") == pytest.approx(0.3)
    assert found.median("adept-nugget-hold") is None
    assert "| planar-slide |                 0.3 |      2 |" in real_time_text(found)


def test_every_target_has_its_loop() -> None:
    assert set(TARGETS) <= set(loops())


def test_what_the_machine_cannot_run_is_left_out() -> None:
    found = RealTime()
    loop = loops()["planar-slide"]._replace(missing=lambda: "no graphics")
    measure(found, rounds=1, timed={"planar-slide": loop})
    assert found.factors == {}
