"""Whatever is asked for, in whatever words: a result or one line, and soon.

``make fuzz`` draws 10,000 command lines; the gate a few of them.
"""

import io
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, Final
from unittest import mock

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from analysis.cli import main
from analysis.run.errors import UserError
from analysis.run.experiment import Experiment, Metric, Outcome
from analysis.run.registry import Entry, find, load, select
from analysis.run.running import prepare
from analysis.run.scenario_fields import leaves
from models.validation import ParameterError

ENTRIES: Final = find()
PATHS: Final = {
    entry.name: [leaf.path for leaf in leaves(load(entry).scenario())] for entry in ENTRIES
}
DRAWN: Final = int(os.environ.get("CHAMFER_FUZZ", "40"))
LONGEST: Final = 20.0  # s, of a command


@pytest.mark.parametrize(
    ("name", "setting", "message"),
    [
        (
            "alignment",
            "compensation_time=1e9",
            "compensation_time is 1000000000.0, allowed: a finite number > 0 and <= 3600",
        ),
        (
            "alignment",
            "cameras.frames.period=1e-9",
            "cameras.frames.period is 1e-09, allowed: a number from 0.0001 to 1000",
        ),
        (
            "step-response",
            "camera.latency=1e9",
            "camera.latency is 1000000000.0, allowed: at most 125 s, 10000 periods of 0.0125 s",
        ),
        (
            "step-response",
            "plant.mass=1e-308",
            "plant.mass is 1e-308, allowed: at least what damping and stiffness can be divided by",
        ),
    ],
)
def test_numbers_beyond_what_can_be_computed_are_named(
    name: str, setting: str, message: str
) -> None:
    with pytest.raises(UserError) as raised:
        prepare(select(find(), [name]), settings=[setting])
    assert str(raised.value) == message


# What is drawn

TEXTS = st.text(st.characters(exclude_characters="\0"), max_size=12).filter(
    lambda text: not text.startswith("-")  # an option, which argparse answers
)
NUMBERS = st.one_of(
    st.sampled_from(
        ["0", "-1", "1", "2", "1e-320", "1e-308", "1e-9", "1e9", "1e308", "nan", "inf", "-inf"]
    ),
    st.floats().map(repr),
    st.floats(1e-3, 1e3).map(repr),
    st.integers(-(10**30), 10**30).map(str),
    st.integers(0, 20).map(str),
)
VALUES = st.one_of(
    NUMBERS,
    st.lists(NUMBERS, max_size=7).map(lambda numbers: f"[{', '.join(numbers)}]"),
    TEXTS,
    st.sampled_from(
        [
            *(
                "",
                "null",
                "true",
                "[",
                "{}",
                "{a: 1}",
                "&a [*a]",
                "*a",
                "!!timestamp abc",
                "<<: 1",
            ),
            *(
                "!!int []",
                "!!binary x",
                "9" * 5000,
                "[" * 2000,
                "? ",
                "--- 1\\n--- 2",
                "pid",
                "fsm",
            ),
        ]
    ),
)
FILES = st.one_of(
    st.none(),
    st.binary(max_size=60),
    TEXTS.map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.builds("{}: {}\n".format, st.sampled_from(sorted(PATHS["alignment"])), VALUES).map(
        lambda text: text.encode("utf-8", "surrogatepass")
    ),
    st.sampled_from([b"{}", b"[]", b'{"scenario": 3}', b'{"scenario": {}}', b"a: &a {<<: *a}"]),
)
PICTURES = st.one_of(
    st.binary(max_size=60),
    st.tuples(st.integers(1, 40), st.integers(1, 40)).map(
        lambda size: cv2.imencode(".png", np.full((*size, 3), 200, np.uint8))[1].tobytes()
    ),
)
FILE_NAMES = st.sampled_from(
    ["a.png", "=1+1.png", "b\udcff.png", "c.mp4", "d.yaml", "e.json", "f"]
)
ENDS = st.sampled_from(
    [None, None, signal.SIGINT, signal.SIGTERM, ParameterError("a", 1, "2"), MemoryError("no")]
)


@st.composite
def settings_of(draw: st.DrawFn, name: str) -> list[str]:
    """Draw what to set in an experiment's scenario."""
    paths = st.sampled_from(PATHS.get(name, ["a"])) | TEXTS
    given = draw(st.lists(st.tuples(paths, VALUES), max_size=3))
    arguments = [part for path, value in given for part in ("--set", f"{path}={value}")]
    return [*arguments, *draw(st.sampled_from([[], [], [], ["--scenario", "FILE"]]))]


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """Draw the arguments of a command; FILE stands for a drawn file, OUT for a folder."""
    command = draw(
        st.sampled_from(["run"] * 6 + ["fields", "diagram", "track", "track"])
        | st.sampled_from(["list", "view", "reproduce"])
        | TEXTS
    )
    name = draw(st.sampled_from([entry.name for entry in ENTRIES]) | TEXTS)
    out = ["--out", draw(st.sampled_from(["OUT", "OUT", "OUT", "FILE", "FILE/a", "a" * 300]))]
    seed = draw(st.sampled_from([[], [], ["--seed", draw(NUMBERS | TEXTS)]]))
    as_json = draw(st.sampled_from([[], ["--json"]]))
    if command == "run":
        given = draw(settings_of(name))
        workers = draw(st.sampled_from([[], [], ["--workers", draw(NUMBERS | TEXTS)]]))
        return [command, name, *given, *seed, *workers, *out, *as_json]
    if command == "diagram":
        return [command, name, *draw(settings_of(name)), *out]
    if command == "view":  # what it accepts it serves until it is interrupted
        return [command, name, *draw(settings_of(name)), "--port", draw(st.sampled_from("0x"))]
    if command == "reproduce":
        return [command, "--paper", draw(TEXTS), *out, *seed, *as_json]
    if command == "track":
        rate = draw(st.sampled_from([[], ["--rate", draw(VALUES.filter(bool))]]))
        given = draw(st.sampled_from([[], ["--set", f"peg.hue={draw(VALUES)}"]]))
        return [command, "FILE", *rate, *given, *out, *as_json]
    if command == "fields":
        return [command, name, draw(TEXTS | st.just("p")), *as_json]
    return [command, *draw(st.lists(TEXTS, max_size=2)), *as_json]


# What is done with it


class Stub:
    """Takes the place of experiments' runs, which would take too long."""

    def __init__(self, end: int | Exception | None) -> None:
        self._end = end

    def load(self, entry: Entry) -> Experiment[Any]:
        return replace(
            load(entry), run=self._run, plot=lambda *_: {}, diagram=None, charts=None, replay=None
        )

    def _run(self, *_: object) -> Outcome:
        if isinstance(self._end, int):
            signal.raise_signal(self._end)
        elif self._end is not None:
            raise self._end
        metrics = {"metric": Metric(value=1.0, unit="")}
        return Outcome(metrics=metrics, traces={"x": np.zeros(1)}, simulated_seconds=0.0)


@contextmanager
def soon() -> Iterator[None]:
    """Raise in the block when it takes too long."""

    def late(_: int, __: FrameType | None) -> None:
        raise AssertionError(f"takes more than {LONGEST:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@settings(
    max_examples=DRAWN,
    deadline=None,
    derandomize="CHAMFER_FUZZ" not in os.environ,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.generate,),  # to shrink a failure takes longer than to understand it
)
@given(command_lines(), FILE_NAMES, FILES | PICTURES, ENDS)
def test_a_drawn_command_ends_soon_in_a_result_or_in_one_line(
    arguments: list[str], name: str, content: bytes | None, end: int | Exception | None
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, name)
        if content is not None:
            file.write_bytes(content)
        places = {"OUT": f"{folder}/out", "FILE": str(file), "FILE/a": str(file / "a")}
        out, err = io.StringIO(), io.StringIO()
        stub = load if arguments[0] == "diagram" else Stub(end).load
        loaded = mock.patch("analysis.run.running.load", stub)
        unchecked = mock.patch("analysis.run.running.check", return_value=[])
        try:
            with soon(), loaded, unchecked, redirect_stdout(out), redirect_stderr(err):
                status = main([places.get(argument, argument) for argument in arguments])
        except SystemExit as ended:  # of --help
            status = int(ended.code or 0)
    said = err.getvalue().splitlines()
    assert status in (0, 1, 2, 130)
    assert all(line.startswith("chamfer: ") for line in said), said
    assert len([line for line in said if ": warning: " not in line]) == (status != 0), said
