"""Runs in three dimensions: ``chamfer view``, and the replay that ``chamfer run`` writes."""

import json
import signal
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path
from urllib.request import urlopen

import pytest

from chamfer.analysis.scenario.experiment import Catalogue

Start = Callable[..., subprocess.Popen[str]]
Chamfer = Callable[..., tuple[int, str, str]]

SEEN = """

def show_trials(scenario, outcome, meshcat):
    from pydrake.geometry import Sphere

    for trial in outcome.traces["trial"]:
        meshcat.SetObject(f"trial_{trial}", Sphere(scenario.noise + 0.1))
    if scenario.noise == 13.0:
        raise ParameterError("noise", scenario.noise, "a lucky number")
"""

ENTRIES = """
        trials("seen", replay="show_trials"),
"""


@pytest.fixture
def seen(more_toys: Callable[[str, str], Catalogue]) -> Catalogue:
    return more_toys(SEEN, ENTRIES)


def free_port() -> int:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        port: int = server.getsockname()[1]
        return port


def is_open(host: str, port: int) -> bool:
    with socket.socket() as client:
        client.settimeout(2)
        return client.connect_ex((host, port)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_view_serves_on_localhost_until_it_is_ended(
    start: Start, seen: Catalogue, sent: int
) -> None:
    port = free_port()
    with start(seen, "view", "seen", "--set", "trials=2", "--port", str(port)) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line == f"http://localhost:{port} shows the run until Ctrl-C\n"
        with urlopen(f"http://localhost:{port}", timeout=10) as page:
            assert b"meshcat" in page.read()
        assert not is_open("127.0.0.2", port)  # what listens everywhere answers there too
        process.send_signal(sent)
        out, err = process.communicate(timeout=10)
    assert (process.returncode, out, err) == (0, "", "")
    assert not is_open("127.0.0.1", port)


def test_view_names_a_port_that_is_taken(chamfer: Chamfer, seen: Catalogue) -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        port = server.getsockname()[1]
        message = f"chamfer: --port is {port}, which is taken, allowed: a free one\n"
        assert chamfer("view", "seen", "--port", port, catalogue=seen) == (2, "", message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(
            (["seen", f"--port={port}"], f"--port is {port!r}, allowed: an integer from 1024 to")
            for port in ("0", "1023", "65536", "-1", "x", "")
        ),
        (["fall"], "fall has no 3-D view"),
        (["see"], "unknown experiment 'see', did you mean 'seen'?"),
        (["seen", "--set", "noise=13"], "seen: noise is 13.0, allowed: a lucky number"),
        (["seen", "fall"], "unrecognized arguments: fall"),
    ],
)
def test_view_says_mistakes_in_one_line(
    chamfer: Chamfer, seen: Catalogue, arguments: list[str], message: str
) -> None:
    status, out, err = chamfer("view", *arguments, catalogue=seen)
    assert (status, out) == (2, "")
    assert err.startswith(f"chamfer: {message}")
    assert err.count("\n") == 1


def test_run_writes_a_replay_and_links_it(chamfer: Chamfer, seen: Catalogue, out: Path) -> None:
    assert chamfer("run", "seen", "trials", "--out", out, catalogue=seen)[0] == 0
    assert json.loads((out / "seen" / "result.json").read_text())["replay"] == "replay.html"
    assert "meshcat" in (out / "seen" / "replay.html").read_text()
    assert "replay" not in json.loads((out / "trials" / "result.json").read_text())
    assert not (out / "trials" / "replay.html").exists()
    assert (out / "index.html").read_text().count('href="seen/replay.html"') == 1


def test_a_replay_that_fails_leaves_no_result(
    chamfer: Chamfer, seen: Catalogue, out: Path
) -> None:
    status, _, err = chamfer("run", "seen", "--set", "noise=13", "--out", out, catalogue=seen)
    assert (status, err) == (2, "chamfer: seen: noise is 13.0, allowed: a lucky number\n")
    assert not (out / "seen").exists()
