from typing import Any

import pytest


@pytest.fixture
def document() -> dict[str, Any]:
    """Return what result.json has of a design: one link inside, one outside, one unbounded."""
    return {
        "design": "insertion",
        "paper": "fsm-visual-servoing",
        "figure": "section 5",
        "seed": 3,
        "verdict": "likely",
        "limiting_link": "two points",
        "margin": -0.25,
        "share": {"value": 0.5, "low": 0.43, "high": 0.57, "draws": 200},
        "links": [
            {
                "name": "camera",
                "bound": 0.001,
                "allowed": 0.004,
                "margin": 0.003,
                "unit": "m",
                "source": "measured <here>",
            },
            {
                "name": "two points",
                "bound": 0.05,
                "allowed": 0.04,
                "margin": -0.01,
                "unit": "rad",
                "source": "statics",
            },
            {
                "name": "torque",
                "bound": 20.0,
                "allowed": 5.0,
                "margin": 15.0,
                "unit": "N m",
                "source": "the arm",
            },
            {
                "name": "settling",
                "bound": None,
                "allowed": 8.0,
                "margin": None,
                "unit": "s",
                "source": "theorem",
            },
        ],
        "changes": [
            {
                "path": "parts.friction",
                "unit": "",
                "value": 0.4,
                "sensitivity": -0.1,
                "to": 0.3,
                "meaning": "of the parts",
            },
            {
                "path": "parts.chamfer_width",
                "unit": "m",
                "value": 0.002,
                "sensitivity": 0.05,
                "to": None,
                "meaning": "of the chamfers",
            },
        ],
        "smallest_change": {
            "path": "parts.friction",
            "unit": "",
            "value": 0.4,
            "sensitivity": -0.1,
            "to": 0.3,
            "meaning": "of the parts",
        },
        "map": None,
        "verified": {
            "trials": 20,
            "seated": 19,
            "success": 0.95,
            "low": 0.751,
            "high": 0.999,
            "failed_trials": 0,
            "endings": {"gave up: it was stopped": 1},
            "largest_force": 3.25,
            "warning": "",
        },
        "scenario": {},
        "scenario_sha256": "0123456789abcdef",
        "overrides": ["parts.friction=0.4"],
        "versions": {"drake": "1.51.1", "control": None},
        "wall_seconds": 1.0,
        "command": "chamfer design insertion --set parts.friction=0.4",
        "figures": [],
        "page": "design.html",
    }
