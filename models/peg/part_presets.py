"""Pegs and holes that others use too, by name: ``--set parts=factory-8mm``.

What a preset does not name is as in the parts of the paper. Lengths are in m.
"""

from collections.abc import Mapping
from typing import Final

_INCH: Final = 0.0254

# The largest size of the NIST assembly task board's pegs, 16 mm (Kimble et al., 2020).
# Assumed: all else.
_NIST_16MM: Final[Mapping[str, object]] = {
    "peg_radius": 0.016 / 2,
    "hole_radius": 0.0161 / 2,
    "friction": 0.3,
    "chamfer_width": 0.001,
    "peg_length": 0.05,
    "hole_length": 0.025,
    "outer_radius": 0.0125,
}

PRESETS: Final[Mapping[str, Mapping[str, object]]] = {
    # Ruybal, Lumia and Wood, section 4: the defaults.
    "paper": {},
    # NISTIR 8198r1 (Cheok, Franaszek, Van Wyk and Marvel, 2018): a peg of A2 tool steel with a
    # diameter of 12.675 mm (0.499 in). Assumed: the bore of 0.500 in, friction of dry steel,
    # chamfers of 0.5 mm each, lengths.
    "nist-12.675mm": {
        "peg_radius": 0.012675 / 2,
        "hole_radius": _INCH / 4,
        "friction": 0.3,
        "chamfer_width": 0.001,
        "peg_length": 0.05,
        "hole_length": 0.025,
        "outer_radius": 0.0105,
    },
    # Isaac Lab, factory_tasks_cfg.py (after Narang et al., Factory, 2022): Peg8mm, 7.986 mm in
    # diameter and 50 mm long, Hole8mm, 8.1 mm and 25 mm deep, friction 0.75 of each. Assumed:
    # chamfers of 0.5 mm each, what is outside.
    "factory-8mm": {
        "peg_radius": 0.007986 / 2,
        "hole_radius": 0.0081 / 2,
        "friction": 0.75,
        "chamfer_width": 0.001,
        "peg_length": 0.05,
        "hole_length": 0.025,
        "outer_radius": 0.0075,
    },
    "nist-16mm": _NIST_16MM,
    # Its square one of that size.
    "nist-16mm-square": {"section": "square", **_NIST_16MM},
}
