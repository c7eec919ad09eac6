"""Toy trials that other processes can import."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

TRIALS = '''
import ctypes
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from chamfer.models.validation import ParameterError

held = []


def square(task):
    return {"square": task**2, "half": task / 2, "steps": np.arange(3.0) * task}


def process(task):
    return {"pid": os.getpid()}


def sleep(seconds):
    time.sleep(seconds)
    return {"seconds": seconds}


def leave(folder, seconds, task):
    """Leave the number of the trial and of the process that runs it, each time it does."""
    Path(folder, f"{task}-{os.getpid()}-{time.monotonic_ns()}").touch()
    time.sleep(seconds)
    return {"square": task**2}


def grow(task):
    held.append(np.ones(3_000_000))  # 24 MB
    return process(task)


def misbehave(task):
    if task == "raise":
        raise ValueError("not\\nthis way")
    if task == "refuse":
        raise ParameterError("mass", -1.0, "a number > 0")
    if task == "assert":
        raise SystemExit("Failure at plant.cc")
    if task == "wrong row":
        return {"x": (1.0, 2.0)}
    if task == "exit":
        os._exit(0)
    if task == "exit 3":
        os._exit(3)
    if task == "crash":
        ctypes.string_at(0)
    if task == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "hang":
        time.sleep(60)
    return {"x": 1.0}


def once(folder, task):
    """Die the first time."""
    path = Path(folder, str(task))
    if task % 5 == 2 and not path.exists():
        path.touch()
        os._exit(1)
    return {"square": task**2}


def environment(names):
    import cv2

    return [cv2.getNumThreads(), *(os.environ.get(name) for name in names)]


def shout(text):
    print(text)
    sys.stdout.flush()
    os.write(1, text.encode())
'''


@pytest.fixture(scope="session")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The module of the toy trials."""
    folder: Path = tmp_path_factory.mktemp("toys")
    (folder / "toy_trials.py").write_text(TRIALS)
    sys.path.insert(0, str(folder))  # handed on to processes that are started
    yield importlib.import_module("toy_trials")
    sys.path.remove(str(folder))
