"""Whatever is asked for, in whatever words: a result or one line, and soon.

``make fuzz`` draws 10,000 command lines; the gate a few of them.
"""

import argparse
import io
import json
import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any, Final
from unittest import mock

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cli import _parser, main
from chamfer.analysis.command.running import prepare
from chamfer.analysis.command.scenario_fields import leaves
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import (
    Entry,
    Experiment,
    Metric,
    Outcome,
    load,
    select,
)

ENTRIES: Final = CATALOGUE.entries
DRAWN: Final = int(os.environ.get("CHAMFER_FUZZ", "40"))
LONGEST: Final = 60.0  # s, of a command on a busy machine that compiles what it runs


@cache
def paths_of(name: str) -> list[str]:
    """Return the fields of an experiment; one that is none of another name."""
    known = [entry for entry in ENTRIES if entry.name == name]
    return [leaf.path for one in known for leaf in leaves(load(one).default)] or ["a"]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("camera.latency=1e9", "is 1000000000.0, allowed: at most 125 s, 10000 periods of 0.0125"),
        ("plant.mass=1e-308", "is 1e-308, allowed: at least what damping and stiffness can be "),
    ],
)
def test_numbers_beyond_what_can_be_computed_are_named(setting: str, message: str) -> None:
    with pytest.raises(UserError) as raised:
        prepare(select(CATALOGUE.entries, ["step-response"]), settings=[setting])
    assert str(raised.value).startswith(f"{setting.partition('=')[0]} {message}")


TEXTS = st.text(st.characters(exclude_characters="\0"), max_size=12).filter(
    lambda text: not text.startswith("-")  # an option, which argparse answers
)
NUMBERS = st.one_of(
    st.sampled_from(["0", "-1", "1e-320", "1e-308", "1e-9", "1e9", "1e308", "nan", "inf", "-inf"]),
    st.floats().map(repr),
    st.floats(1e-3, 1e3).map(repr),
    st.integers(-(10**30), 10**30).map(str),
    st.integers(0, 20).map(str),
)
BROKEN: Final = ["<<: 1", "!!timestamp abc", "!!int []", "!!binary x", "&a [*a]", "--- 1\n--- 2"]
VALUES = st.one_of(
    NUMBERS,
    st.lists(NUMBERS, max_size=7).map(lambda numbers: f"[{', '.join(numbers)}]"),
    TEXTS,
    st.sampled_from(["", "null", "true", "[", "{}", "{a: 1}", "*a", "? ", "pid", "fsm"]),
    st.sampled_from([*BROKEN, "9" * 5000, "[" * 2000]),
)
RESULT: Final = {
    "experiment": "alignment",
    "seed": 0,
    "scenario": {"gap": 0.2, "peg": {"posture": [0.1, -0.2]}},
    "metrics": {"time": {"value": 1.5, "unit": "s"}, "none": {"value": None, "unit": ""}},
}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=5,
)


# Results, of which a part may be something else.
RESULTS = st.builds(
    lambda part: json.dumps({**RESULT, **part}).encode(),
    st.dictionaries(st.sampled_from(list(RESULT)), JSON, max_size=1),
)
FIELDS = st.builds(
    "{}: {}\n".format, st.deferred(lambda: st.sampled_from(paths_of("alignment"))), VALUES
)
FILES = st.one_of(
    st.none(),
    RESULTS,
    st.binary(max_size=60),
    (TEXTS | FIELDS).map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.sampled_from([b"{}", b"[]", b'{"scenario": 3}', b'{"scenario": {}}', b"a: &a {<<: *a}"]),
    st.tuples(st.integers(1, 40), st.integers(1, 40)).map(
        lambda size: cv2.imencode(".png", np.full((*size, 3), 200, np.uint8))[1].tobytes()
    ),
)
FILE_NAMES = st.sampled_from(
    ["a.png", "=1+1.png", "b\udcff.png", "c.mp4", "d.yaml", "e.json", "f"]
)
SPECS = st.one_of(
    st.lists(VALUES, min_size=1, max_size=3).map(lambda values: f"={','.join(values)}"),
    st.builds("={}:{}:{}".format, NUMBERS, NUMBERS, st.integers(-1, 4) | st.just(10**7)),
    st.builds("~{}:{}".format, NUMBERS, NUMBERS),
    TEXTS,
)
NAMES = st.sampled_from([entry.name for entry in ENTRIES]) | TEXTS
FOLDERS = st.sampled_from(["FIRST", "FIRST", "SECOND", "SECOND", "FILE", "OUT", "a" * 300])
# What arguments take by their names or what stands for them; the others any value.
TAKEN: Final[dict[Any, st.SearchStrategy[str]]] = {
    "--out": st.sampled_from(["OUT", "OUT", "OUT", "FILE", "FILE/a", "a" * 300]),
    "--port": st.sampled_from(["0", "x"]),  # what it accepts it serves until it is interrupted
    "--metric": st.just("metric") | TEXTS,
    "--design": st.sampled_from(["grid", "sobol", "random", "x"]),
    "--board": st.builds("chessboard:{}x{}:{}mm".format, NUMBERS, NUMBERS, NUMBERS) | TEXTS,
    "X,Y,W,H": st.sampled_from(["0,0,12,12", "4,4,20,20", "20,4,20,20"]) | TEXTS,
    "DIR": FOLDERS,
    **dict.fromkeys(("FILE", "FILES", "PICTURE"), st.just("FILE")),
}
GIVEN: Final = {"--out", "--board", "--port", "--paper", "--vary"}
(SUBPARSERS,) = _parser()._subparsers._group_actions  # type: ignore[union-attr]
COMMANDS: Final[dict[str, list[argparse.Action]]] = {
    name: [one for one in parser._actions if one.dest not in ("help", "cluster")]
    for name, parser in SUBPARSERS.choices.items()  # type: ignore[union-attr]
    if name != "design"  # computes for long
}


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """Draw the arguments of a command; FILE stands for a drawn file, OUT for a folder."""
    often = ["run"] * 5 + ["sweep"] * 3 + ["compare"]
    command = draw(st.sampled_from([*often, *COMMANDS]) | TEXTS)
    name = draw(NAMES)
    paths = st.sampled_from(paths_of(name)) | TEXTS
    taken = TAKEN | {
        "NAME": st.just(name),
        "--set": st.builds("{}={}".format, paths if command != "track" else TEXTS, VALUES),
        "--vary": st.builds("{}{}".format, paths, SPECS),
    }
    arguments = [command]
    for action in COMMANDS.get(command, []):
        option = "".join(action.option_strings)
        values = taken.get(option, taken.get(action.metavar, VALUES))
        if not option:
            arguments.append(draw(values))
        elif option in GIVEN or draw(st.integers(0, 3)) == 0:
            for _ in range(draw(st.integers(1, 3)) if option in ("--set", "--vary") else 1):
                arguments += [option] if action.nargs == 0 else [option, draw(values)]
    return arguments


def end_run(*_: object) -> Outcome:
    metrics = {"metric": Metric(value=1.0, unit="")}
    return Outcome(metrics=metrics, traces={"x": np.zeros(1)}, simulated_seconds=0.0)


def load_stub(entry: Entry) -> Experiment[Any]:
    """Load an experiment whose run is a stub, as its own would take too long."""
    real = load(entry)
    resolve = real.resolve
    return Experiment(default=real.default, resolve=resolve, run=end_run, plot=lambda *_: {})


def call_here(function: Callable[..., Any], *arguments: Any, **_: float | None) -> Future[Any]:
    future: Future[Any] = Future()
    future.set_result(function(*arguments))
    return future


@contextmanager
def engines(_: int, cluster: str | None) -> Iterator[tuple[Any, Any]]:
    """Give engines that call at once, in this process."""
    assert cluster is None
    here = SimpleNamespace(exact=True, processors=("this",), submit=call_here)
    here.capacity, here.close = lambda: 1, lambda: None
    yield here, here


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
@given(command_lines(), FILE_NAMES, FILES, RESULTS)
def test_a_drawn_command_ends_soon_in_a_result_or_in_one_line(
    arguments: list[str],
    name: str,
    content: bytes | None,
    result: bytes,
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, name)
        places = {
            "OUT": f"{folder}/out",
            "FILE": str(file),
            "FILE/a": str(file / "a"),
            "FIRST": f"{folder}/first",
            "SECOND": f"{folder}/second",
        }
        if content is not None:
            file.write_bytes(content)
        for place in ("first", "second"):
            Path(folder, place).mkdir()
            Path(folder, place, "result.json").write_bytes(
                content if place == "first" and content is not None else result
            )
        out, err = io.StringIO(), io.StringIO()
        stubs = {
            "command.running.load": load if arguments[0] == "diagram" else load_stub,
            "command.running.check": lambda *_: [],
            "sweep.sweep.load": load_stub,
            # First where they are taken: a module that is imported now takes the real ones.
            "command.session.engines": engines,
            "campaign.cluster.engines": engines,
        }
        with ExitStack() as stack:
            for place, stub in stubs.items():
                stack.enter_context(mock.patch(f"chamfer.analysis.{place}", stub))
            stack.enter_context(redirect_stdout(out))
            stack.enter_context(redirect_stderr(err))
            stack.enter_context(soon())
            try:
                status = main([places.get(one, one) for one in arguments])
            except SystemExit as ended:  # of --help
                status = int(ended.code or 0)
    said = err.getvalue().splitlines()
    assert status in (0, 1, 2)
    assert all(line.startswith("chamfer: ") for line in said), said
    if status == 1 and arguments[0] == "sweep":  # the points say why
        return
    assert len([line for line in said if ": warning: " not in line]) == (status != 0), said
