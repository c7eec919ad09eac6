import itertools

import numpy as np
import pytest

from chamfer.analysis.benchmarks.engine import Engine
from chamfer.analysis.benchmarks.timing import Times, interleave, ratio


class _Machine:
    """Engines that take as long as they are told, on a clock of their own."""

    def __init__(self) -> None:
        self.now = 0.0
        self.order: list[str] = []

    def clock(self) -> float:
        return self.now

    def engine(self, name: str, seconds: float, *, interrupt_at: int | None = None) -> Engine:
        count = itertools.count()

        def build() -> None:
            self.now += 0.25

        def run(_: None) -> np.ndarray:
            if next(count) == interrupt_at:
                raise KeyboardInterrupt
            self.order.append(name)
            self.now += seconds
            return np.zeros(1)

        return Engine(name=name, build=build, run=run, accuracy=0.0, note="")


@pytest.mark.slow
def test_engines_take_turns_and_every_round_begins_with_another() -> None:
    machine, times = _Machine(), dict[str, Times]()
    engines = [machine.engine(name, 1.0) for name in "abc"]
    interleave(engines, times, rounds=4, share=100.0, clock=machine.clock)
    assert "".join(machine.order) == "abcbcacababc"


@pytest.mark.slow
def test_a_slow_engine_sits_out_after_its_share() -> None:
    machine, times = _Machine(), dict[str, Times]()
    engines = [machine.engine("fast", 0.75), machine.engine("slow", 3.75)]
    interleave(engines, times, rounds=6, share=9.0, clock=machine.clock)
    assert times["fast"].rounds == 6
    assert times["slow"].rounds == 2


def test_an_engine_slower_than_its_share_gets_one_round() -> None:
    machine, times = _Machine(), dict[str, Times]()
    interleave([machine.engine("a", 50.0)], times, rounds=3, share=1.0, clock=machine.clock)
    assert times["a"].rounds == 1


@pytest.mark.slow
def test_building_is_timed_apart() -> None:
    machine, times = _Machine(), dict[str, Times]()
    interleave([machine.engine("a", 2.0)], times, rounds=3, share=100.0, clock=machine.clock)
    assert times["a"].building == [0.25] * 3
    assert times["a"].running == [2.0] * 3


def test_an_interrupt_keeps_what_there_is() -> None:
    machine, times = _Machine(), dict[str, Times]()
    engines = [machine.engine("a", 1.0), machine.engine("b", 1.0, interrupt_at=1)]
    with pytest.raises(KeyboardInterrupt):
        interleave(engines, times, rounds=9, share=100.0, clock=machine.clock)
    assert times["b"].rounds == 1
    assert len(times["b"].building) == 1


def test_medians_and_ratios() -> None:
    times = Times(building=[3.0, 1.0, 2.0], running=[4.0, 100.0, 2.0, 6.0])
    assert times.build == 2.0
    assert times.run == 5.0
    assert Times().run is None
    assert ratio(10.0, 4.0) == 2.5
    assert ratio(None, 4.0) is None
    assert ratio(10.0, None) is None
