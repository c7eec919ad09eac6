"""The cell from the side as an inline SVG, with the part marked that limits a design."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any, Final

from chamfer.analysis.design.design_words import percent, quantity, relation

# The limiting part has a halo and a thick outline, those outside of their limits a dashed one.
STYLE: Final = """
.cell { display: block; width: 100%; max-width: 34rem; height: auto; margin: 0 auto;
  font: 15px system-ui, sans-serif; }
.cell text { fill: var(--soft); }
.cell .part { fill: none; stroke: #6e7781; stroke-width: 2; stroke-linejoin: round; }
.cell .solid { fill: var(--paper); }
.cell .peg .solid { fill: #e8b4b4; }
.cell .hole { fill: #b9c4ea; stroke: #6e7781; stroke-width: 2; }
.cell .light { stroke: var(--line); stroke-dasharray: 3 4; fill: none; }
.cell .outside { stroke: var(--no); stroke-width: 2.5; stroke-dasharray: 7 3; }
.cell .limits { stroke: var(--limit); stroke-width: 4; stroke-dasharray: none; }
.cell .halo { fill: none; stroke: var(--limit); stroke-width: 15; stroke-opacity: .25;
  stroke-linejoin: round; stroke-linecap: round; }
.cell .leader { fill: none; stroke: var(--limit); stroke-width: 1.5; }
.cell .limit { fill: var(--limit); font-weight: 700; }
.cell .size { fill: none; stroke: var(--soft); stroke-width: 1.2; }
.cell text.inside { fill: #1f2328; }
"""

_PART_OF: Final = {
    "sight": "cameras",
    **dict.fromkeys(("settled", "settling", "range", "time", "attempts"), "compensator"),
    **dict.fromkeys(("start", "loop", "torque", "posture", "repeatability", "deflection"), "arms"),
    **dict.fromkeys(("wedging", "jamming", "push", "force"), "peg"),
    **dict.fromkeys(("chamfer", "edge", "turn", "touch", "search"), "mouth"),
    "depth": "bottom",
}
"""The part of a link, by its name's first word."""

_CAMERA: Final = '<path class="solid" d="M-12 -9 H12 V9 H-12 Z M-7 9 L-11 18 H11 L7 9"/>'
_ARM: Final = (
    '<path d="M24 200 V178 H56 V200 M40 178 V170 L88 100 L136 140 H142 l3 -7 l5 14 l5 -14 l5 14 '
    'l3 -7 H170"/>'
    + "".join(
        f'<circle class="solid" cx="{x}" cy="{y}" r="6"/>' for x, y in ((40, 170), (88, 100))
    )
    + '<circle class="solid" cx="136" cy="140" r="5"/>'
)
_MIRRORED: Final = f'<g transform="translate(460 0) scale(-1 1)">{_ARM}</g>'
_FIXTURE: Final = '<path class="solid" d="M296 118 H340 V200 H310 V162 H296 Z"/>'
# Shapes, and the way from the part to what is said below; what is drawn later is above.
_PARTS: Final[Mapping[str, tuple[str, str]]] = {
    "cameras": (
        f'<g transform="translate(230 22)">{_CAMERA}</g>'
        f'<g transform="translate(290 30) rotate(28)">{_CAMERA}</g>',
        "M308 30 H454 V214 H6",
    ),
    "compensator": (
        '<rect class="solid" x="20" y="10" width="120" height="28"/>',
        "M20 24 H6",
    ),
    "arms": ("", "M40 200 V214 H6"),
    "peg": (
        '<path class="solid" d="M170 131 H234 L239 135 V145 L234 149 H170 Z"/>',
        "M196 149 V214 H6",
    ),
    "mouth": ('<path d="M224 120 L234 130 M224 160 L234 150"/>', "M224 160 V214 H6"),
    "bottom": ('<path d="M284 130 V150"/>', "M284 150 V214 H6"),
}
_HOLE: Final = (
    '<path class="hole" d="M224 112 H296 V168 H224 V160 L234 150 H284 V130 H234 L224 120 Z"/>'
)
_HELD: Final = {"arm": "sensor", "rcc": "RCC"}
_LIGHT: Final = (
    '<path class="light" d="M226 40 L180 112 M234 40 L296 112 M278 42 L190 124 M286 48 L292 110"/>'
    '<path class="part" d="M216 24 H146 m7 -5 l-8 5 l8 5"/>'
)
_SCENE: Final = (
    '<path class="part" d="M40 38 V158 m-5 -7 l5 8 l5 -8"/><path class="part" d="M10 200 H450"/>'
)

_SECTION: Final = (
    '<path class="hole" d="M236 14 H400 V126 H236 V110 L246 100 H350 V40 H246 L236 30 Z"/>'
    '<g class="part peg"><path class="solid" d="M30 44 H188 L194 50 V90 L188 96 H30"/></g>'
    '<path class="size" d="M194 40 V12 M236 12 V8 M194 18 H236 m-6 -4 l6 4 l-6 4 M200 14 l-6 4 '
    "l6 4 M236 130 V146 M350 104 V146 M236 140 H350 m-6 -4 l6 4 l-6 4 M242 136 l-6 4 l6 4 "
    'M214 116 L240 107"/>'
)
"""Peg and hole in section, with the lines of the dimensions."""

Document = Mapping[str, Any]


def cell_picture(document: Document) -> str:
    """Return the cell of a ``result.json`` as an SVG element for a page with STYLE."""
    limiting = next(one for one in document["links"] if one["name"] == document["limiting_link"])
    limits, outside = _part(limiting), {_part(one) for one in document["links"] if _outside(one)}
    cell = document.get("scenario", {})
    fixture = cell.get("hole", {}).get("kind") == "fixture"
    positions = cell.get("arm", {}).get("control") == "position"
    sees = cell.get("cameras", {}).get("kind", "pair") != "none"
    arms = _ARM + ("" if fixture else _MIRRORED)
    shapes = {name: arms if name == "arms" else shape for name, (shape, _) in _PARTS.items()}
    shapes |= {} if sees else {"cameras": ""}
    scene = (_LIGHT if sees else "") + _SCENE
    drawn = [scene, f'<g class="part">{_FIXTURE}</g>' if fixture else "", _HOLE]
    for name, shape in shapes.items():
        kinds = ["part", name]
        kinds += ["outside"] if name in outside else []
        if name == limits:
            kinds.append("limits")
            drawn.append(
                f'<g class="halo">{shape}</g><path class="leader" d="{_PARTS[name][1]} V252"/>'
            )
        drawn.append(f'<g class="{" ".join(kinds)}">{shape}</g>')
    allowed = quantity(limiting["allowed"], limiting["unit"])
    bound = (
        "infinite" if limiting["bound"] is None else quantity(limiting["bound"], limiting["unit"])
    )
    words = [
        (80, 29, "middle", "controller" if positions else "compensator", ""),
        *([(312, 20, "start", "cameras", "")] if sees else []),
        *([(154, 123, "middle", _HELD[cell["compliance"]["kind"]], "")] if positions else []),
        (60, 195, "start", "peg's arm", ""),
        (400, 195, "end", "fixture" if fixture else "hole's arm", ""),
        (16, 232, "start", f"{limiting['name']}: {bound}", "limit"),
        (
            *(16, 250, "start"),
            f"{relation(limiting)} {allowed} allowed, margin {percent(limiting['share'])}",
            "",
        ),
    ]
    colour = "var(--no)" if _outside(limiting) else "var(--certain)"
    section, height = (_section(cell), 428) if "parts" in cell else ("", 256)
    said = escape(f"the cell from the side, {limiting['name']} limits", quote=True)
    return (
        f'<svg class="cell" style="--limit: {colour}" viewBox="0 0 460 {height}" role="img" '
        f'aria-label="{said}">{"".join(drawn)}{section}{_texts(words)}</svg>'
    )


def _section(cell: Document) -> str:
    """Return peg and hole in section with their dimensions, not to scale."""
    parts, insert = cell["parts"], cell["insert"]
    sign = "⌀ " if parts["section"] == "round" else ""
    peg, hole = (2 * parts[f"{name}_radius"] for name in ("peg", "hole"))
    clearance = quantity((hole - peg) / 2, "m")
    words = [
        (110, 75, "middle", f"{sign}{quantity(peg, 'm')}", "inside"),
        (298, 75, "middle", f"{sign}{quantity(hole, 'm')}", ""),
        (186, 24, "end", f"gap {quantity(cell['gap'], 'm')}", ""),
        (208, 122, "end", f"chamfer {quantity(parts['chamfer_width'], 'm')}", ""),
        (293, 160, "middle", f"depth {quantity(insert['depth'], 'm')}", ""),
        (16, 160, "start", f"radial clearance {clearance}", ""),
        (450, 160, "end", "not to scale", ""),
    ]
    return f'<g transform="translate(0 262)">{_SECTION}{_texts(words)}</g>'


def _texts(words: Iterable[tuple[int, int, str, str, str]]) -> str:
    return "".join(
        f'<text class="{kind}" x="{x}" y="{y}" text-anchor="{anchor}">{escape(text)}</text>'
        for x, y, anchor, text, kind in words
    )


def _part(link: Document) -> str:
    return _PART_OF.get(link["name"].partition(".")[0], "")


def _outside(link: Document) -> bool:
    return link["bound"] is None or (link["margin"] is not None and link["margin"] < 0)
