"""What a fresh process needs: the command against the imports that no result can do without."""

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Final

IMPORTS: Final = "import pydrake, control, matplotlib"
ALL_IMPORTS: Final = "import pydrake.all, control, matplotlib"
COMMAND: Final = "chamfer run step-response"


@dataclass
class ColdStart:
    """Times, s, of fresh processes by what they did, and why the ones that failed did."""

    times: dict[str, list[float]] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    def median(self, name: str) -> float | None:
        """Return the median time of a process, s, or None if it was never measured."""
        return median(self.times[name]) if self.times.get(name) else None


def measure(
    found: ColdStart, *, rounds: int, environment: Mapping[str, str] | None = None
) -> None:
    """Start the processes in turns; the first round only warms the file cache."""
    with tempfile.TemporaryDirectory() as folder:
        commands = {
            IMPORTS: [sys.executable, "-c", IMPORTS],
            ALL_IMPORTS: [sys.executable, "-c", ALL_IMPORTS],
            COMMAND: [
                *(sys.executable, "-m", "chamfer.analysis.cli", "run", "step-response"),
                *("--out", folder),
            ],
        }
        for number in range(rounds + 1):
            for name, command in commands.items():
                if name not in found.failures:
                    _start(found, name, command, environment, counts=number > 0)


def _start(
    found: ColdStart,
    name: str,
    command: list[str],
    environment: Mapping[str, str] | None,
    *,
    counts: bool,
) -> None:
    start = perf_counter()
    process = subprocess.run(
        command,
        env=environment,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    elapsed = perf_counter() - start
    if process.returncode != 0:
        last = process.stderr.strip().splitlines()[-1:] or [f"exit status {process.returncode}"]
        found.failures[name] = last[0]
    elif counts:
        found.times.setdefault(name, []).append(elapsed)
