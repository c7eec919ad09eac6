"""A law in C answers as the law in Python, to the last bit."""

import ctypes
import math
import shutil
import struct
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.export.c_code import LawInC
from chamfer.models.validation import ParameterError
from chamfer.systems.law import Signal
from chamfer.systems.servo.compensator_law import AxisParams, CompensatorLaw, CompensatorParams
from chamfer.systems.servo.pid_law import PidGains, PidLaw, SampledPidParams

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-pedantic")
RUN = 500  # steps
COMPILER = shutil.which("gcc") or shutil.which("cc")

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")

Values = Mapping[str, list[float] | None]


def compensator(*axes: AxisParams, ends: bool) -> CompensatorLaw:
    end = 0.0125 * (RUN - 20) if ends else math.inf
    return CompensatorLaw(CompensatorParams(axes=axes, end_time=end))


NARROW = AxisParams(dead_zone=0.01, large_error=0.12, increment=0.009, limit=0.05)
UNBOUND = AxisParams(dead_zone=0.5, large_error=0.5, increment=0.7, divider=3.0)
BOUND = PidGains(proportional=0.6, integral=9.0, derivative=0.01, limit=1.0)
FREE = PidGains(proportional=1.5, integral=0.3)

LAWS = {
    "compensator": compensator(NARROW, ends=False),
    "compensator, three axes that end": compensator(NARROW, UNBOUND, NARROW, ends=True),
    "PID": PidLaw(SampledPidParams(axes=(BOUND,))),
    "PID, two axes": PidLaw(SampledPidParams(axes=(BOUND, FREE), period=0.01)),
}
# Where an answer changes, of each input.
EDGES = {
    "error": [0.01, 0.12, 0.5, math.nextafter(0.01, 0), math.nextafter(0.12, 0), 0.0, 1e308],
    "valid": [0.0, 0.5, math.nextafter(0.5, 0), 1.0],
}


def draw(signals: Mapping[str, Signal], random: Random) -> Values:
    def value(name: str) -> float:
        kind = random.random()
        edge = random.choice(EDGES.get(name, [0.0])) * random.choice([-1.0, 1.0])
        lost = random.choice([math.nan, math.inf, -math.inf])
        return float(lost if kind < 0.02 else edge if kind < 0.3 else random.gauss(0, 0.3))

    return {
        name: None
        if signal.optional and random.random() < 0.3
        else [value(name) for _ in range(signal.size)]
        for name, signal in signals.items()
    }


def struct_of(signals: Mapping[str, Signal]) -> type[ctypes.Structure]:
    class Vectors(ctypes.Structure):
        _fields_ = [
            field
            for name, signal in signals.items()
            for field in (
                *([(f"has_{name}", ctypes.c_bool)] if signal.optional else []),
                (name, ctypes.c_double * signal.size),
            )
        ]

    return Vectors


class Compiled:
    """A law in C, behind the face of the law."""

    def __init__(self, law: Any, folder: Path) -> None:
        c_law = LawInC("some", "block", law, ("tricky: */ /* ??/ \\",))
        for name, text in c_law.files().items():
            folder.joinpath(name).write_text(text)
        command = (COMPILER, *STRICT, "-O2", "-ffp-contract=off", "-fPIC", "-shared", "some.c")
        subprocess.run([*map(str, command), "-o", "some.so", "-lm"], cwd=folder, check=True)
        self.library = ctypes.CDLL(str(folder / "some.so"))
        self.inputs = struct_of(law.inputs)()
        self.outputs = struct_of(law.outputs)()
        self.state = ctypes.create_string_buffer(4096)
        self.start()

    def start(self) -> None:
        self.library.some_init(self.state, ctypes.byref(self.outputs))

    def step(self, values: Values, time: float) -> bool:
        for name, value in values.items():
            if hasattr(self.inputs, f"has_{name}"):
                setattr(self.inputs, f"has_{name}", value is not None)
            if value is not None:
                getattr(self.inputs, name)[:] = value
        to = ctypes.byref(self.inputs), ctypes.c_double(time), ctypes.byref(self.outputs)
        return int(self.library.some_step(self.state, *to)) == 0

    def given(self) -> bytes:
        return bits(
            number for name, _ in self.outputs._fields_ for number in getattr(self.outputs, name)
        )


def bits(numbers: Iterator[float]) -> bytes:
    return b"".join(struct.pack("d", math.nan if math.isnan(one) else one) for one in numbers)


@needs_compiler
@pytest.mark.parametrize("steps", [5_000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", LAWS)
def test_a_law_in_c_answers_to_the_last_bit(name: str, steps: int, tmp_path: Path) -> None:
    law: Any = LAWS[name]
    compiled, random = Compiled(law, tmp_path), Random(steps)
    refused = 0
    for i in range(steps):
        if i % RUN == 0:
            state = law.start()
            compiled.start()
        values, time = draw(law.inputs, random), (i % RUN) * law.period
        try:
            with np.errstate(all="ignore"):  # of numbers beyond all others
                state = law.update(state, law.observe(values), time)
            took = True
        except (ParameterError, ValueError):
            took = False
        assert compiled.step(values, time) == took, (i, values)
        command = law.command(state)
        assert compiled.given() == bits(one for vector in command for one in vector), (i, values)
        refused += not took
    assert refused < steps / 5
