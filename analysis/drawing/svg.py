"""A graph as a self-contained SVG picture."""

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import Final
from xml.sax.saxutils import escape, quoteattr

from chamfer.analysis.drawing.graph import Graph
from chamfer.analysis.drawing.layout import ClusterBox, GraphLayout, NodeBox, Point, Route, lay_out
from chamfer.analysis.drawing.text import SUBSCRIPT_LETTERS, TextBlock

_Style = dict[str, str | float]

_FONT: Final = "Helvetica, Arial, 'Liberation Sans', sans-serif"
_INK: Final = "#1f2937"
_STROKE: Final[_Style] = {"stroke": _INK, "stroke_width": 1.3}
_FILL: Final = "#f3f4f6"
_LOOKS: Final[dict[str, _Style]] = {
    "failed": {"fill": "#d1d5db", "stroke_width": 2.4},
    "any": {"fill": "white", "stroke_dasharray": "4 3"},
}
_FRAME: Final = "#6b7280"
_LABEL: Final = "#374151"
_HEAD: Final = (8.0, 3.6)  # length of an arrow head and half its width, px
_BASELINE: Final = 0.8  # of the font size: the first baseline below the upper edge, with leading
_BOX_CORNER: Final = {"state": 12.0, "final": 12.0, "failed": 12.0, "any": 17.0, "source": 21.0}


def render(graph: Graph, layout: GraphLayout | None = None) -> str:
    """Draw a graph, by default laid out whole; the SVG document is the same for the same graph."""
    layout = layout or lay_out(graph)
    size = {"width": layout.width, "height": layout.height}
    box = f"0 0 {_number(layout.width)} {_number(layout.height)}"
    lines = [
        f"<title>{escape(graph.title or 'diagram')}</title>",
        f"<desc>{escape(_described(layout))}</desc>",
        _tag("rect", **size, fill="white"),
        _text(layout.title, 20.0, 20.0, _INK, anchor="start", font_weight="bold"),
        # Outer frames first, so that an inner one is drawn on top of them.
        *(_cluster(cluster) for cluster in layout.clusters),
        *_wires(layout),
        *(_node(box) for box in layout.boxes),
        *(
            _text(label.text, label.x + label.text.width / 2, label.y, _LABEL)
            for label in layout.labels
        ),
        *(_sign(route) for route in layout.routes if route.edge.sign),
    ]
    content = "\n".join(["", *filter(None, lines), ""])
    about: _Style = {"xmlns": "http://www.w3.org/2000/svg", **size, "viewBox": box, "role": "img"}
    return _tag("svg", content, **about, font_family=_FONT) + "\n"


def _described(layout: GraphLayout) -> str:
    """Return what is drawn in a sentence, for those who do not see it."""
    names = [box.node.label for box in layout.boxes if box.node.kind != "port" and box.node.label]
    chart = any(box.node.kind == "initial" for box in layout.boxes)
    kind, noun, lines = ("Block diagram", "blocks", "signals")
    if chart:
        kind, noun, lines = ("State chart", "states", "transitions")
    return f"{kind} with {len(names)} {noun} and {len(layout.routes)} {lines}: {', '.join(names)}."


def _tag(name: str, content: str = "", /, **attributes: str | float) -> str:
    """Return an element; underscores of attributes are hyphens, as in ``stroke_width``."""
    parts = [name]
    for key, value in attributes.items():
        text = value if isinstance(value, str) else _number(value)
        parts.append(f"{key.replace('_', '-')}={quoteattr(text)}")
    return f"<{' '.join(parts)}>{content}</{name}>" if content else f"<{' '.join(parts)}/>"


def _group(kind: str, title: str, *content: str) -> str:
    return _tag("g", "".join([f"<title>{escape(title)}</title>", *content]), **{"class": kind})


def _points(points: Sequence[Point]) -> str:
    return " ".join(f"{_number(x)},{_number(y)}" for x, y in points)


def _cluster(box: ClusterBox) -> str:
    corner = {"x": box.x, "y": box.y, "width": box.width, "height": box.height, "rx": 4.0}
    frame = _tag("rect", **corner, fill="none", stroke=_FRAME, stroke_dasharray="5 4")
    look = {"anchor": "start", "font_variant": "small-caps"}
    title = _text(box.title, box.x + 10, box.y + 7, _FRAME, **look)
    return _group("cluster", box.cluster.label, frame, title)


def _wires(layout: GraphLayout) -> list[str]:
    nets: defaultdict[tuple[str, str], list[Route]] = defaultdict(list)
    for route in layout.routes:
        nets[route.edge.source, route.edge.source_port].append(route)
    lines = []
    for (source, _), routes in nets.items():
        targets = ", ".join(route.edge.target for route in routes)
        # One path, which is inked once where its branches lie on each other.
        outline = "".join(_outline(route.points) for route in routes)
        line = _tag("path", d=outline, fill="none", stroke_linejoin="round", **_STROKE)
        heads = (_head(route.points) for route in routes)
        lines.append(_group("edge", f"{source} \N{RIGHTWARDS ARROW} {targets}", line, *heads))
    lines += [_tag("circle", cx=x, cy=y, r=2.6, fill=_INK) for x, y in layout.branches]
    return lines


def _outline(points: Sequence[Point]) -> str:
    """Return a line up to its arrow head as a path."""
    corners = [*points[:-1], _before(points[-1], points[-2], _HEAD[0] - 1)]
    return "M" + "L".join(f"{_number(x)} {_number(y)}" for x, y in corners)


def _head(points: Sequence[Point]) -> str:
    length, half = _HEAD
    tip = points[-1]
    x, y = _before(tip, points[-2], length)
    dx, dy = half * (tip[0] - x) / length, half * (tip[1] - y) / length
    return _tag("polygon", points=_points([tip, (x - dy, y + dx), (x + dy, y - dx)]), fill=_INK)


def _before(tip: Point, start: Point, distance: float) -> Point:
    """Return the point at a distance before the tip of a straight line."""
    share = distance / math.dist(tip, start)
    return tip[0] + (start[0] - tip[0]) * share, tip[1] + (start[1] - tip[1]) * share


def _sign(route: Route) -> str:
    (x0, y0), (x, y) = route.points[-2:]
    from_left = abs(x - x0) > abs(y - y0)
    x, y = (x - 9, y - 6) if from_left else (x + 9, y + 14 if y < y0 else y - 6)
    sign = "\N{MINUS SIGN}" if route.edge.sign == "-" else route.edge.sign
    return _tag("text", escape(sign), x=x, y=y, font_size=13.0, text_anchor="middle", fill=_INK)


def _node(box: NodeBox) -> str:
    middle = box.width / 2
    if box.shape == "triangle":
        middle = box.width * (0.62 if box.mirrored else 0.38)
    top = box.y + (box.height - box.text.height) / 2
    parts = [*_shape(box), _text(box.text, box.x + middle, top, _INK)]
    parts.append(_text(box.caption, box.x + box.width / 2, box.y + box.height + 3, _LABEL))
    return _group(box.node.kind, box.node.label or box.node.id, *parts)


def _shape(box: NodeBox) -> list[str]:
    if box.shape == "text":
        return []
    left, right, bottom = box.x, box.x + box.width, box.y + box.height
    if box.shape in ("circle", "dot"):
        radius, fill = box.width / 2, _INK if box.shape == "dot" else "white"
        centre = {"cx": left + radius, "cy": box.y + radius, "r": radius}
        return [_tag("circle", **centre, fill=fill, **_STROKE)]
    if box.shape == "triangle":
        flat, tip = (right, left) if box.mirrored else (left, right)
        points = [(flat, box.y), (tip, box.y + box.height / 2), (flat, bottom)]
        return [_tag("polygon", points=_points(points), fill=_FILL, **_STROKE)]
    kind = box.node.kind
    style = {**_STROKE, "fill": _FILL, **_LOOKS.get(kind, {})}
    double = [_rect(box, 3.5, **_STROKE, fill="none")] if kind in ("final", "failed") else []
    return [_rect(box, 0.0, **style), *double]


def _rect(box: NodeBox, inset: float, **style: str | float) -> str:
    corner = min(_BOX_CORNER.get(box.node.kind, 2.0) - inset, box.height / 2)
    width, height = box.width - 2 * inset, box.height - 2 * inset
    place = {"x": box.x + inset, "y": box.y + inset, "width": width, "height": height}
    return _tag("rect", **place, rx=corner, **style)


def _text(
    text: TextBlock, x: float, top: float, ink: str, *, anchor: str = "middle", **more: str
) -> str:
    """Draw lines of text below a height, centred on x or starting there."""
    first = top + (text.line_height - text.size) / 2 + _BASELINE * text.size
    look: _Style = {"font_size": text.size, "text_anchor": anchor, "fill": ink, **more}
    return "".join(
        _tag("text", _runs(line, text.size), x=x, y=first + i * text.line_height, **look)
        for i, line in enumerate(text.lines)
    )


def _runs(line: str, size: float) -> str:
    """Return a line of text as markup, with subscripts."""
    drop, small = size * 0.25, size * 0.75
    # What is before each subscript, its letters, what is before the next one, ...
    plain, *rest = SUBSCRIPT_LETTERS.split(line)
    parts = [escape(plain)]
    for lower, raised in zip(rest[::2], rest[1::2], strict=True):
        parts.append(_tag("tspan", escape(lower), dy=drop, font_size=small))
        parts.append(_tag("tspan", escape(raised), dy=-drop) if raised else "")
    return "".join(parts)


def _number(value: float) -> str:
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text
