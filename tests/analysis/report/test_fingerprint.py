import enum
import math
import operator
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import pytest

from chamfer.analysis.report import fingerprint
from chamfer.analysis.report.fingerprint import (
    Code,
    canonical,
    code,
    digest,
    modules_of,
    processor,
)


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


class Pair(NamedTuple):
    first: float
    second: float


@dataclass(frozen=True)
class Inner:
    x: float = 1.0
    y: float | None = None


@dataclass(frozen=True)
class Outer:
    inner: Inner = Inner()
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Other:
    inner: Inner = Inner()
    names: tuple[str, ...] = ()


DIFFERENT = (
    *(None, False, True, 0, 1, 1.0, 0.0, -0.0, math.nan, math.inf, "", "1", b"1", "None"),
    *((), (1,), [1], (1, (2,)), ((1, 2),), (1, 2), "(1, 2)", {1}, {1: 2}, {2: 1}, frozenset({1})),
    *(range(3), range(4), Colour.RED, Colour.BLUE, Pair(1.0, 2.0), (1.0, 2.0)),
    *(np.arange(3), np.arange(3.0), np.arange(3.0).reshape(3, 1), np.zeros(3)),
    *(Inner(), Inner(y=1.0), Outer(), Outer(inner=Inner(x=2.0)), Outer(names=("a",)), Other()),
    *(Inner, Outer, math.sqrt, math.sin, operator.add, PurePosixPath("a"), "a"),
    *(partial(pow, 2), partial(pow, 3), partial(pow, exp=2), pow, partial(operator.add, 2)),
)


def test_different_values_have_different_texts() -> None:
    for one, other in combinations(DIFFERENT, 2):
        assert canonical(one) != canonical(other)


def test_equal_values_have_the_same_text() -> None:
    assert canonical(math.nan) == canonical(float("nan"))
    assert canonical({"a": 1, "b": 2}) == canonical({"b": 2, "a": 1})
    assert canonical(np.float64(0.1)) == canonical(0.1)
    assert canonical(np.arange(6)[::2]) == canonical(np.array([0, 2, 4]))
    assert digest(Outer(), 3) == digest(Outer(inner=Inner()), 3)
    assert digest(Outer(), 3) != digest(3, Outer())


@pytest.mark.parametrize(
    "value",
    [lambda x: x, object(), np.array([object()]), (1, {"a": object()}), partial(lambda: 0)],
)
def test_what_has_no_text_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="a trial can't depend on"):
        canonical(value)


def test_a_digest_is_the_same_in_every_process() -> None:
    script = (
        "from chamfer.analysis.report.fingerprint import digest\n"
        "print(digest({'a', 'b', 'c'}, {'x': 0.1}, print).hex())"
    )
    own = digest({"a", "b", "c"}, {"x": 0.1}, print).hex()
    for seed in ("1", "2"):
        changes = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(fingerprint._ROOT / "src")}
        found = subprocess.check_output([sys.executable, "-c", script], env=os.environ | changes)
        assert found.decode() == f"{own}\n"


def test_modules_are_those_of_all_functions() -> None:
    assert modules_of(partial(partial(math.pow, 2.0), 3.0)) == ("math",)
    assert modules_of(processor) == ("chamfer.analysis.report.fingerprint",)
    within = partial(processor, replace, 1, key=os.path.join)
    assert modules_of(within) == (
        "chamfer.analysis.report.fingerprint",
        "dataclasses",
        "posixpath",
    )


def fresh_code(*modules: str) -> Code:
    code.cache_clear()
    return code(modules)


def test_sources_are_also_those_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "ours").mkdir()

    def own(file: str, text: str, module: str) -> Code:
        (tmp_path / file).write_text(text)
        top = file.partition("/")[0].removesuffix(".py")
        monkeypatch.delitem(sys.modules, top, raising=False)
        __import__(top)
        return fresh_code(module)

    project = fresh_code("chamfer.analysis.campaign.campaign")
    assert fresh_code("chamfer.diagrams.anything") == project
    first = own("mine.py", "x = 1\n", "mine")
    assert first.sources != project.sources
    assert fresh_code("mine") == first
    assert own("mine.py", "x = 2\n", "mine").sources != first.sources
    first = own("ours/__init__.py", "", "ours.inner")
    assert own("ours/beside.py", "", "ours.inner").sources != first.sources


@pytest.mark.parametrize("folder", ["models/arms", "systems", "diagrams", "analysis/published"])
def test_sources_are_all_of_the_project(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    (tmp_path / folder).mkdir(parents=True)
    monkeypatch.setattr(fingerprint, "_ROOT", tmp_path)
    digests = [fresh_code("chamfer.analysis").sources]
    for name in ("new.py", "arm.urdf", "notes.txt"):
        (tmp_path / folder / name).write_text("x")
        digests.append(fresh_code("chamfer.analysis").sources)
    code.cache_clear()
    assert len(set(digests)) == 3  # the notes don't count
    assert digests[2] == digests[3]


def test_what_differs_is_named() -> None:
    own = code(("chamfer.analysis",))
    assert own.differs(own) is None
    assert own.differs(replace(own, sources="")) == "the sources"
    names = [name for name, _ in own.versions]
    assert {"python", "drake", "numpy", "scipy", "numba"} <= set(names)
    other = replace(own, versions=tuple((name, "0") for name in names))
    assert own.differs(other) == f"python, {own.versions[0][1]} and 0"
