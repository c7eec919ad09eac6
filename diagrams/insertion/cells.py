"""Presets of whole cells: ``--set cell=ur5e-fixture``; other fields keep their defaults."""

from collections.abc import Mapping
from typing import Any, Final

Cells = Mapping[str, Mapping[str, Any]]

_FIXTURE: Final[dict[str, Any]] = {
    "axis": "downwards",
    "gap": 0.01,
    "begin": 0.5,
    "cameras": {"kind": "none"},
    "step": 0.002,
}

CELLS: Final[Cells] = {
    # The paper's: two WAMs under impedance control, two cameras at right angles.
    "wam-pair": {},
    # A collaborative arm with a gripper below a six-axis sensor, which knows where the fixture is
    # by a drawing. Lengths, masses and torques of the arm are the maker's; the rest is assumed.
    "ur5e-fixture": {
        **_FIXTURE,
        "parts": "factory-8mm",
        "arm": {"control": "position"},
        "peg": {
            "model": "ur5e",
            "base": {"position": (-0.8, 0.0, -0.35)},
            "tool": {
                "mass": 1.0,
                "centre_of_mass": (-0.1, 0.0, 0.0),
                "inertia": (1e-3, 3e-3, 3e-3),
                "frame": {"position": (0.0, 0.0, 0.2)},
            },
            "payload_error": 0.05,
            "payload_position": (-0.1, 0.0, 0.0),
        },
        "compliance": {"lateral": 2e4, "axial": 5e4, "angular": 60.0, "torsional": 60.0},
        "admittance": {"spring": (1.0, 1.0, 1.0, 1000.0, 400.0, 400.0)},
        "hole": {
            "kind": "fixture",
            "payload_error": 0.0,
            "position_error": 0.002,
            "angle_error": 0.035,
        },
        "search": {"kind": "spiral"},
        "insert": {"speed": 0.005, "push": 20.0, "pull": 25.0, "force_limit": 30.0},
        "spread": {"lateral": 0.002, "rotational": 0.035},
    },
    # A SCARA arm that gives way nowhere but in its remote centre compliance, without a camera.
    "scara-rcc": {
        **_FIXTURE,
        "parts": "nist-16mm",
        "arm": {
            "control": "position",
            "servo": {"rate": 250.0, "bandwidth": 15.0, "repeatability": 2.5e-5},
        },
        "peg": {
            "model": "scara",
            "base": {"position": (-0.9, 0.0, -0.95)},
            "tool": {"frame": {"position": (0.0, 0.0, 0.12)}},
            "payload_error": 0.02,
        },
        "compliance": {"kind": "rcc", "axial": 1e5},
        "admittance": {"kind": "none"},
        "hole": {
            "kind": "fixture",
            "payload_error": 0.0,
            "position_error": 0.0005,
            "angle_error": 0.01,
        },
        "insert": {"speed": 0.002, "push": 40.0, "pull": 45.0, "force_limit": 60.0},
        "spread": {"lateral": 0.0005, "rotational": 0.01},
    },
}

_START: Final = {  # of one insertion, about half of what is believed at most
    "ur5e-fixture": (0.0, 0.0012, -0.0008, 0.0, 0.02, -0.015),
    "scara-rcc": (0.0, 0.0003, -0.0002, 0.0, 0.006, -0.005),
}


def single(cells: Cells) -> Cells:
    """Return the presets of one insertion, with an error instead of its spread."""
    return {
        name: {field: value for field, value in of.items() if field != "spread"}
        | ({"initial_error": _START[name]} if name in _START else {})
        for name, of in cells.items()
    }
