"""A law in C answers as the law in Python, to the last bit."""

import ctypes
import math
import shutil
import struct
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.export.c_code import LawInC
from chamfer.systems.force.accommodation_law import AccommodationLaw, AccommodationParams
from chamfer.systems.force.admittance_law import AdmittanceLaw, AdmittanceParams
from chamfer.systems.law import Signal
from chamfer.systems.servo.compensator_law import AxisParams, CompensatorLaw, CompensatorParams
from chamfer.systems.servo.pid_law import PidGains, PidLaw, SampledPidParams

COMPILER = shutil.which("gcc") or shutil.which("cc")
STRICT = "-std=c99 -Wall -Wextra -Werror -Wconversion -pedantic"
LIBRARY = "-O2 -ffp-contract=off -fPIC -shared some.c -o some.so -lm"
RUN = 500  # steps
NARROW = AxisParams(dead_zone=0.01, large_error=0.12, increment=0.009, limit=0.05)
UNBOUND = AxisParams(dead_zone=0.5, large_error=0.5, increment=0.7, divider=3.0)
BOUND = PidGains(proportional=0.6, integral=9.0, derivative=0.01, limit=1.0)
FREE = PidGains(proportional=1.5, integral=0.3)
THREE, END = (NARROW, UNBOUND, NARROW), 0.0125 * (RUN - 20)
HEAVY: Any = {"inertia": (0.01, 0.02, 0, 1, 2, 3), "spring": (0, 5, 6, 100, 0, 300)}
CENTRE = (0.02, -0.01, 0.05)
SOFT = (6.0, 8.0, math.inf, 1500.0, 2000.0, 1500.0)
LAWS: dict[str, Any] = {
    "compensator": CompensatorLaw(CompensatorParams(axes=(NARROW,))),
    "three axes that end": CompensatorLaw(CompensatorParams(axes=THREE, end_time=END)),
    "PID of two axes": PidLaw(SampledPidParams(axes=(BOUND, FREE))),
    "accommodation": AccommodationLaw(AccommodationParams()),
    "remote centre": AccommodationLaw(AccommodationParams(centre=CENTRE, damping=SOFT)),
    "admittance": AdmittanceLaw(AdmittanceParams(damping=SOFT, **HEAVY)),
    "remote mass": AdmittanceLaw(AdmittanceParams(centre=CENTRE, allow_unstable=True, **HEAVY)),
}
EDGES = {  # where an answer changes
    "error": [0.01, 0.12, 0.5, math.nextafter(0.01, 0), math.nextafter(0.12, 0), 0.0, 1e308],
    "damping": [0.0, 0.8, 0.8 * (1 - 1e-9), 800.0, 900.0, 5000.0, math.inf],
    "valid": [0.0, 0.5, math.nextafter(0.5, 0), 1.0],
}
GENERAL = ("three axes that end", "PID of two axes", "remote centre", "admittance")


def draw(signals: Mapping[str, Signal], random: Random) -> dict[str, list[float] | None]:
    def number(name: str) -> float:
        kind = random.random()
        edge = random.choice(EDGES.get(name, [0.0])) * random.choice([-1.0, 1.0])
        lost = random.choice([math.nan, math.inf, -math.inf])
        usual = random.uniform(1e3, 9e3) if name == "damping" else random.gauss(0, 0.3)
        return lost if kind < 0.01 else edge if kind < 0.2 else usual

    return {
        name: None
        if signal.optional and random.random() < 0.3
        else [number(name) for _ in range(signal.size)]
        for name, signal in signals.items()
    }


def struct_of(signals: Mapping[str, Signal]) -> Any:
    fields: list[tuple[str, Any]] = []
    for name, signal in signals.items():
        fields += [(f"has_{name}", ctypes.c_bool)] if signal.optional else []
        fields += [(name, ctypes.c_double * signal.size)]
    return type("Vectors", (ctypes.Structure,), {"_fields_": fields})()


def bits(vectors: Iterable[Iterable[float]]) -> bytes:
    numbers = [number for vector in vectors for number in vector]
    return struct.pack(f"{len(numbers)}d", *(math.nan if math.isnan(x) else x for x in numbers))


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
@pytest.mark.parametrize(
    ("name", "steps"),
    [
        *((name, 3_000) for name in LAWS),
        *(pytest.param(name, 100_000, marks=pytest.mark.slow) for name in GENERAL),
    ],
)
def test_a_law_in_c_answers_to_the_last_bit(name: str, steps: int, tmp_path: Path) -> None:
    law = LAWS[name]
    for file, text in LawInC("some", law, ("tricky: */ /* ??/ \\",)).files().items():
        tmp_path.joinpath(file).write_text(text)
    command = [str(COMPILER), *STRICT.split(), *LIBRARY.split()]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "some.so"))
    inputs, outputs = struct_of(law.inputs), struct_of(law.outputs)
    memory, random, refused = ctypes.create_string_buffer(4096), Random(name), 0
    for i in range(steps):
        if i % RUN == 0:
            state = law.start()
            library.some_init(memory, ctypes.byref(outputs))
        values, time = draw(law.inputs, random), (i % RUN) * law.period
        for signal, value in values.items():
            if law.inputs[signal].optional:
                setattr(inputs, f"has_{signal}", value is not None)
            if value is not None:
                getattr(inputs, signal)[:] = value
        answer = library.some_step(
            memory, ctypes.byref(inputs), ctypes.c_double(time), ctypes.byref(outputs)
        )
        try:
            with np.errstate(all="ignore"):  # of numbers beyond all others
                state = law.update(state, law.observe(values), time)
            assert answer == 0, (i, values)
        except ValueError:
            assert answer != 0, (i, values)
            refused += 1
        given = (getattr(outputs, signal) for signal in law.outputs)
        held = law.command(state)
        assert bits(given) == bits(getattr(held, one) for one in law.outputs), (i, values)
    assert refused < steps / 2
