"""Meshcat on localhost, pages that need nothing else, and animations of what a plant did."""

import base64
import gc
import logging
import math
import re
import socket
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Box, Meshcat, MeshcatVisualizer
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.analysis.report.replay import FRAME_RATE, open_meshcat, record, replay_html, set_stage


def animation(page: str) -> dict[str, dict[str, tuple[list[int], Any]]]:
    """Return frames' numbers and values of a page's animation, by path and property."""
    messages = [base64.b64decode(one) for one in re.findall("base64,([A-Za-z0-9+/=]+)", page)]
    (message,) = [msgpack.unpackb(one) for one in messages if b"set_animation" in one[:32]]
    assert message["options"]["play"] is True
    found = {}
    for part in message["animations"]:
        assert part["clip"]["fps"] == FRAME_RATE
        found[part["path"]] = {
            track["name"]: (
                [key["time"] for key in track["keys"]],
                np.array([key["value"] for key in track["keys"]]),
            )
            for track in part["clip"]["tracks"]
        }
    return found


def make_slider(meshcat: Meshcat) -> tuple[Diagram, MultibodyPlant]:
    """Return a body that slides along y, and its plant."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    body = plant.AddRigidBody(
        "slider", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidCube(1.0))
    )
    plant.AddJoint(PrismaticJoint("y", plant.world_frame(), body.body_frame(), [0, 1, 0]))
    plant.RegisterVisualGeometry(body, RigidTransform(), Box(1, 1, 1), "box", np.ones(4))
    plant.Finalize()
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return builder.Build(), plant


def show_slider(time: Any, y: Any) -> Any:
    def show(meshcat: Meshcat) -> None:
        set_stage(meshcat, floor=np.zeros(3), eye=np.ones(3), target=np.zeros(3))
        record(
            meshcat, *make_slider(meshcat), np.asarray(time), np.asarray(y, dtype=float)[:, None]
        )

    return show


def slides(page: str) -> tuple[list[int], Any]:
    """Return frames' numbers and the slider's positions."""
    tracks = animation(page)
    (path,) = [path for path in tracks if "slider" in path]
    frames, p_WB = tracks[path][".position"]
    assert not p_WB[:, [0, 2]].any()
    return frames, p_WB[:, 1]


def is_open(host: str, port: int) -> bool:
    with socket.socket() as client:
        client.settimeout(2)
        return client.connect_ex((host, port)) == 0


@pytest.mark.parametrize("port", [None, 0])
def test_meshcat_listens_on_localhost_only_and_says_nothing(
    port: int | None, capfd: pytest.CaptureFixture[str]
) -> None:
    level = logging.getLogger("drake").level
    meshcat = open_meshcat(port)
    found = meshcat.port()
    assert is_open("127.0.0.1", found)
    assert not is_open("127.0.0.2", found)  # what listens on every address answers there too
    assert meshcat.web_url() == f"http://localhost:{found}"
    assert logging.getLogger("drake").level == level
    del meshcat
    assert not is_open("127.0.0.1", found)
    assert capfd.readouterr() == ("", "")


def test_pages_need_nothing_else_and_are_the_same_for_the_same_run() -> None:
    ports = []

    def show(meshcat: Meshcat) -> None:
        ports.append(meshcat.port())
        show_slider([0.0, 1.0], [0.0, 0.5])(meshcat)

    pages = [replay_html(show) for _ in range(2)]
    assert pages[0] == pages[1]
    assert len(pages[0]) < 3e6
    assert not re.search(r"<[^>]*\s(src|href)=", pages[0])
    assert not [port for port in ports if is_open("127.0.0.1", port)]


def test_the_port_is_free_again_after_a_failure() -> None:
    ports = []

    def show(meshcat: Meshcat) -> None:
        ports.append(meshcat.port())
        show_slider([0.0], [math.nan])(meshcat)

    with pytest.raises(ValueError, match="positions are not finite in row 0"):
        replay_html(show)
    gc.collect()  # what the error refers to
    assert not is_open("127.0.0.1", ports[0])


def test_frames_follow_the_positions_and_move_evenly_between_their_times() -> None:
    frames, shown = slides(replay_html(show_slider([3.0, 3.1, 3.2], [0.0, 1.0, 0.0])))
    assert frames == list(range(9))
    np.testing.assert_allclose(shown, [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0], atol=1e-12)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    steps=st.lists(st.floats(1e-4, 0.3), max_size=12),
    start=st.floats(-100, 100),
    y=st.lists(st.floats(-1, 1), min_size=13, max_size=13),
)
def test_begins_and_ends_as_the_run_did(steps: list[float], start: float, y: list[float]) -> None:
    time = start + np.concatenate([[0.0], np.cumsum(steps)])
    frames, shown = slides(replay_html(show_slider(time, y[: len(time)])))
    assert frames == list(range(len(frames)))
    assert (len(frames) - 2) / FRAME_RATE < time[-1] - time[0] + 1e-6
    assert (len(frames) - 1) / FRAME_RATE > time[-1] - time[0] - 1e-6
    assert shown[0] == y[0]
    assert shown[-1] == pytest.approx(y[len(time) - 1], abs=1e-3)


@pytest.mark.parametrize(
    ("time", "y", "message"),
    [
        ([0.0, 1.0], [0.0, math.inf], "positions are not finite in row 1"),
        ([0.0, math.nan], [0.0, 1.0], "times are not finite in row 1"),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "times have to ascend"),
        ([], [], "times have to ascend, and there has to be one"),
    ],
)
def test_impossible_traces(time: list[float], y: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replay_html(show_slider(time, y))
