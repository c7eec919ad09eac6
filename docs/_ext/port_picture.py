"""A block as a box with its ports, as SVG that takes the page's colours."""

from collections.abc import Sequence
from typing import Final
from xml.sax.saxutils import escape

from chamfer.analysis.drawing.text import text_width

_OPTIONAL: Final = " (optional)"
_SIZE: Final = 13.0  # px, of the names
_ROW: Final = 22.0  # px, from port to port
_WIRE: Final = 26.0  # px, outside the box
_GAP: Final = 34.0  # px, between the names of inputs and outputs
_MARGIN: Final = 9.0  # px, between a name and the box
_TITLE: Final = 30.0  # px, its height
_HEAD: Final = 7.0  # px, length of an arrow head


def port_picture(name: str, inputs: Sequence[str], outputs: Sequence[str]) -> str:
    """Draw a block: inputs at the left, outputs at the right, optional ones dashed.

    Args:
        name: What stands above the ports.
        inputs: Names, with " (optional)" behind those that need not be connected.
        outputs: Names.
    """
    left, right = (
        max((_width(port) for port in ports), default=0.0) for ports in (inputs, outputs)
    )
    gap = _GAP if inputs and outputs else 0.0
    inner = max(left + gap + right, text_width(name, _SIZE) * 1.1) + 2 * _MARGIN
    rows = max(len(inputs), len(outputs), 1)
    height = _TITLE + rows * _ROW + 6
    width = inner + 2 * _WIRE
    label = f"{name}: inputs {', '.join(inputs) or 'none'}; outputs {', '.join(outputs) or 'none'}"
    parts = [
        f'<svg class="ports" xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" '
        f'height="{height + 2:.0f}" viewBox="0 0 {width:.0f} {height + 2:.0f}" role="img" '
        f'aria-label="{escape(label)}" font-family="sans-serif" font-size="{_SIZE:g}" '
        'fill="currentColor" stroke="none" style="max-width:100%;height:auto">',
        f'<rect x="{_WIRE:g}" y="1" width="{inner:.1f}" height="{height:.1f}" rx="4" '
        'fill="currentColor" fill-opacity="0.06" stroke="currentColor"/>',
        f'<text x="{width / 2:.1f}" y="20" text-anchor="middle" font-weight="bold">'
        f"{escape(name)}</text>",
    ]
    for ports, at, anchor, wire in (
        (inputs, _WIRE + _MARGIN, "start", 0.0),
        (outputs, width - _WIRE - _MARGIN, "end", width - _WIRE),
    ):
        for row, port in enumerate(ports):
            y = _TITLE + (row + 0.5) * _ROW
            parts += _port(port, at, y, anchor, wire)
    return "".join([*parts, "</svg>"])


def _port(port: str, x: float, y: float, anchor: str, wire: float) -> list[str]:
    optional = port.endswith(_OPTIONAL)
    style = ' font-style="italic"' if optional else ""
    dash = ' stroke-dasharray="4 3"' if optional else ""
    tip = wire + _WIRE
    return [
        f'<path d="M{wire:.1f} {y:.1f}H{tip - _HEAD:.1f}" stroke="currentColor"{dash}/>',
        f'<path d="M{tip:.1f} {y:.1f}l{-_HEAD:g} -3.5v7z"/>',
        f'<text x="{x:.1f}" y="{y + 4.5:.1f}" text-anchor="{anchor}"{style}>'
        f"{escape(_shown(port))}</text>",
    ]


def _shown(port: str) -> str:
    return port.removesuffix(_OPTIONAL)


def _width(port: str) -> float:
    return text_width(_shown(port), _SIZE)
