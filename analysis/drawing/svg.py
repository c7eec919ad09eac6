"""A graph as a self-contained SVG picture."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final
from xml.sax.saxutils import escape, quoteattr

from chamfer.analysis.drawing.frames import Point
from chamfer.analysis.drawing.graph import Graph
from chamfer.analysis.drawing.layout import Box, ClusterBox, Layout, Route, lay_out
from chamfer.analysis.drawing.text import SUBSCRIPT, TextBlock

_FONT: Final = "Helvetica, Arial, 'Liberation Sans', sans-serif"
_INK: Final = "#1f2937"
_FILL: Final = "#f3f4f6"
_DARK_FILL: Final = "#d1d5db"
_FRAME: Final = "#6b7280"
_LABEL: Final = "#374151"
_CORNER: Final = 6.0  # px, radius of a line's bends
_HEAD: Final = (8.0, 3.6)  # length of an arrow head and half its width, px
_BASELINE: Final = 0.8  # of the font size: the first baseline below the upper edge, with leading
_BOX_CORNER: Final = {"state": 12.0, "final": 12.0, "failed": 12.0, "any": 17.0, "source": 21.0}


def render(graph: Graph) -> str:
    """Draw a graph.

    Args:
        graph: What to draw.

    Returns:
        An SVG document, the same for the same graph.
    """
    layout = lay_out(graph)
    width, height = _number(layout.width), _number(layout.height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" role="img" font-family={quoteattr(_FONT)}>',
        f"<title>{escape(graph.title or 'diagram')}</title>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    if layout.title.lines:
        lines.append(
            _text(layout.title, 20.0, 20.0, _INK, anchor="start", extra=' font-weight="bold"')
        )
    # Outer frames first, so that an inner one is drawn on top of them.
    lines += [_cluster(cluster) for cluster in layout.clusters]
    lines += _wires(layout)
    lines += [_node(box) for box in layout.boxes]
    for label in layout.labels:
        middle = label.x + label.text.width / 2
        lines.append(_text(label.text, middle, label.y, _LABEL))
    lines += [sign for route in layout.routes if (sign := _sign(route))]
    lines.append("</svg>")
    return "\n".join(lines) + "\n"


def _cluster(box: ClusterBox) -> str:
    title = _text(
        box.title,
        box.x + 10,
        box.y + 7,
        _FRAME,
        anchor="start",
        extra=' font-variant="small-caps"',
    )
    return (
        f'<g class="cluster"><title>{escape(box.cluster.label)}</title>'
        f'<rect x="{_number(box.x)}" y="{_number(box.y)}" width="{_number(box.width)}" '
        f'height="{_number(box.height)}" rx="4" fill="none" stroke="{_FRAME}" '
        f'stroke-dasharray="5 4"/>{title}</g>'
    )


def _wires(layout: Layout) -> list[str]:
    branches = set(layout.branches)
    lines = []
    drawn: dict[tuple[str, str], list[tuple[Point, ...]]] = {}
    for route in layout.routes:
        name = f"{route.edge.source} \N{RIGHTWARDS ARROW} {route.edge.target}"
        same_signal = drawn.setdefault((route.edge.source, route.edge.source_port), [])
        # Ink over ink looks bolder: a branch starts where it leaves the line.
        points = min(
            (_after_fork(route.points, other) for other in same_signal),
            key=_total_length,
            default=route.points,
        )
        same_signal.append(route.points)
        lines.append(
            f'<g class="edge"><title>{escape(name)}</title>'
            f'<path d="{_path(points, branches)}" fill="none" stroke="{_INK}" '
            f'stroke-width="1.3"/>{_head(points)}</g>'
        )
    for x, y in layout.branches:
        lines.append(f'<circle cx="{_number(x)}" cy="{_number(y)}" r="2.6" fill="{_INK}"/>')
    return lines


def _after_fork(points: tuple[Point, ...], other: tuple[Point, ...]) -> tuple[Point, ...]:
    """Return what is left of a line after the piece that it has in common with another one."""
    for i, ((a, b), (c, d)) in enumerate(zip(pairwise(points), pairwise(other), strict=False)):
        if b == d:
            continue
        common = min(_length(a, b), _length(c, d))
        same_way = _towards(a, b, common) == _towards(c, d, common)
        fork = _towards(a, b, common) if same_way else a
        return (fork, *(points[i + 1 :] if fork != b else points[i + 2 :]))
    return points


def _total_length(points: tuple[Point, ...]) -> float:
    return sum(_length(a, b) for a, b in pairwise(points))


def _path(points: Sequence[Point], branches: set[Point]) -> str:
    tip = points[-1]
    end = _towards(tip, points[-2], _HEAD[0] - 1)
    corners = [*points[:-1], end]
    parts = [f"M{_number(corners[0][0])} {_number(corners[0][1])}"]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        radius = min(_CORNER, _length(before, corner) / 2, _length(corner, after) / 2)
        if (round(corner[0], 1), round(corner[1], 1)) in branches:
            radius = 0.0
        start, stop = _towards(corner, before, radius), _towards(corner, after, radius)
        parts.append(f"L{_number(start[0])} {_number(start[1])}")
        if radius:
            parts.append(
                f"Q{_number(corner[0])} {_number(corner[1])} {_number(stop[0])} {_number(stop[1])}"
            )
    parts.append(f"L{_number(end[0])} {_number(end[1])}")
    return "".join(parts)


def _head(points: Sequence[Point]) -> str:
    tip = points[-1]
    base = _towards(tip, points[-2], _HEAD[0])
    dx, dy = (tip[0] - base[0]) / _HEAD[0], (tip[1] - base[1]) / _HEAD[0]
    half = _HEAD[1]
    corners = [
        tip,
        (base[0] - dy * half, base[1] + dx * half),
        (base[0] + dy * half, base[1] - dx * half),
    ]
    text = " ".join(f"{_number(x)},{_number(y)}" for x, y in corners)
    return f'<polygon points="{text}" fill="{_INK}"/>'


def _sign(route: Route) -> str:
    if not route.edge.sign:
        return ""
    (x0, y0), (x, y) = route.points[-2:]
    from_left = abs(x - x0) > abs(y - y0)
    place = (x - 9, y - 6) if from_left else (x + 9, y + 14 if y < y0 else y - 6)
    sign = "\N{MINUS SIGN}" if route.edge.sign == "-" else route.edge.sign
    return (
        f'<text x="{_number(place[0])}" y="{_number(place[1])}" font-size="13" '
        f'text-anchor="middle" fill="{_INK}">{escape(sign)}</text>'
    )


def _node(box: Box) -> str:
    title = f"<title>{escape(box.node.label or box.node.id)}</title>"
    parts = [f'<g class="{box.node.kind}">{title}', *_shape(box)]
    if box.text is not None and box.text.lines:
        middle = box.x + box.width / 2
        if box.shape == "triangle":
            middle = box.x + box.width * (0.62 if box.mirrored else 0.38)
        top = box.y + (box.height - box.text.height) / 2
        parts.append(_text(box.text, middle, top, _INK))
    if box.caption is not None:
        parts.append(_text(box.caption, box.x + box.width / 2, box.y + box.height + 3, _LABEL))
    return "".join([*parts, "</g>"])


def _shape(box: Box) -> list[str]:
    ink = f'stroke="{_INK}" stroke-width="1.3"'
    radius = box.width / 2
    if box.shape == "text":
        return []
    if box.shape in ("circle", "dot"):
        fill = _INK if box.shape == "dot" else "white"
        return [
            f'<circle cx="{_number(box.x + radius)}" cy="{_number(box.y + radius)}" '
            f'r="{_number(radius)}" fill="{fill}" {ink}/>'
        ]
    if box.shape == "triangle":
        flat, tip = (box.x + box.width, box.x) if box.mirrored else (box.x, box.x + box.width)
        points = [
            (flat, box.y),
            (tip, box.y + box.height / 2),
            (flat, box.y + box.height),
        ]
        text = " ".join(f"{_number(x)},{_number(y)}" for x, y in points)
        return [f'<polygon points="{text}" fill="{_FILL}" {ink}/>']
    corner = _BOX_CORNER.get(box.node.kind, 2.0)
    fill = {"failed": _DARK_FILL, "any": "white"}.get(box.node.kind, _FILL)
    dash = ' stroke-dasharray="4 3"' if box.node.kind == "any" else ""
    shapes = [_rect(box, 0.0, corner, f'fill="{fill}" {ink}{dash}')]
    if box.node.kind in ("final", "failed"):
        shapes.append(_rect(box, 3.5, corner - 3, f'fill="none" {ink}'))
    if box.node.kind == "failed":
        shapes[0] = _rect(box, 0.0, corner, f'fill="{fill}" stroke="{_INK}" stroke-width="2.4"')
    return shapes


def _rect(box: Box, inset: float, corner: float, style: str) -> str:
    return (
        f'<rect x="{_number(box.x + inset)}" y="{_number(box.y + inset)}" '
        f'width="{_number(box.width - 2 * inset)}" height="{_number(box.height - 2 * inset)}" '
        f'rx="{_number(min(corner, box.height / 2))}" {style}/>'
    )


def _text(
    text: TextBlock, x: float, top: float, ink: str, *, anchor: str = "middle", extra: str = ""
) -> str:
    """Draw lines of text below a height, centred on x or starting there."""
    lines = []
    for i, line in enumerate(text.lines):
        y = top + i * text.line_height + (text.line_height - text.size) / 2 + _BASELINE * text.size
        lines.append(
            f'<text x="{_number(x)}" y="{_number(y)}" font-size="{_number(text.size)}" '
            f'text-anchor="{anchor}" fill="{ink}"{extra}>{_runs(line, text.size)}</text>'
        )
    return "".join(lines)


def _runs(line: str, size: float) -> str:
    """Return a line of text as markup, with subscripts."""
    drop = _number(size * 0.25)
    parts: list[str] = []
    end = 0
    for match in SUBSCRIPT.finditer(line):
        parts.append(_raised(line[end : match.end(1)], drop if parts else ""))
        small = _number(size * 0.75)
        parts.append(f'<tspan dy="{drop}" font-size="{small}">{escape(match[2])}</tspan>')
        end = match.end()
    if end < len(line):
        parts.append(_raised(line[end:], drop if parts else ""))
    return "".join(parts)


def _raised(text: str, by: str) -> str:
    """Return text as markup, raised back from a subscript."""
    return f'<tspan dy="-{by}">{escape(text)}</tspan>' if by else escape(text)


def _length(a: Point, b: Point) -> float:
    return abs(a[0] - b[0]) + abs(a[1] - b[1])


def _towards(start: Point, goal: Point, distance: float) -> Point:
    """Return the point at a distance from the start; the two differ along one axis only."""
    length = _length(start, goal)
    if not length:
        return start
    share = distance / length
    return start[0] + (goal[0] - start[0]) * share, start[1] + (goal[1] - start[1]) * share


def _number(value: float) -> str:
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text
