"""reStructuredText from plain texts: headings, tables, figures."""

import re
from collections.abc import Sequence


def heading(text: str, mark: str = "=") -> str:
    """Return a heading of the level that its mark has."""
    return f"{text}\n{mark * max(len(text), 4)}\n"


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], widths: str, *, name: str = ""
) -> str:
    """Return a table; ``widths`` are shares of its columns, and ``name`` its class."""
    lines = [".. list-table::", "   :header-rows: 1", f"   :widths: {widths}"]
    lines += [f"   :class: {name}", ""] if name else [""]
    for row in (header, *rows):
        for i, cell in enumerate(row):
            lines.append(f"   {'* -' if i == 0 else '  -'} {cell}".rstrip())
    return "\n".join([*lines, ""])


def figure(path: str, caption: str, alt: str, *, drawn: bool = False) -> str:
    """Return a figure with its caption and alternative text; a drawing has a dark variant."""
    options = f"   :alt: {' '.join(alt.split())}\n" + "   :class: drawn\n" * drawn
    return f".. figure:: {path}\n{options}\n   {plain(caption)}\n"


def container(names: str, *parts: str) -> str:
    """Return parts in a box that has classes."""
    return f".. container:: {names}\n\n{indented(chr(10).join(parts), 3)}\n"


def code(text: str) -> str:
    """Return a text as code, or nothing."""
    return f"``{text}``" if text else ""


def plain(text: str) -> str:
    """Return a text none of whose characters mean anything to reStructuredText."""
    return re.sub(r"([\\*`|_\[\]<>])", r"\\\1", " ".join(text.split()))


def indented(text: str, by: int) -> str:
    """Return a text further to the right."""
    return "\n".join(" " * by + line if line else "" for line in text.splitlines())
