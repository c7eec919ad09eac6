"""How much room text takes, where it breaks, and how names of the code are typeset."""

import re
import textwrap
from dataclasses import dataclass
from typing import Final

# Advance widths of Helvetica in 1/1000 of the font size; Arial and Liberation Sans are equal.
_WIDTHS: Final = {
    char: width
    for width, chars in {
        191: "'",
        222: "ijl",
        260: "|",
        278: " !,./:;I[\\]ft",
        333: "()-`r",
        334: "{}",
        355: '"',
        389: "*",
        469: "^",
        500: "Jcksvxyz",
        556: "#$0123456789?L_abdeghnopqu",
        584: "+<=>~",
        611: "FTZ",
        667: "&ABEKPSVXY",
        722: "CDHNRUw",
        778: "GOQ",
        833: "Mm",
        889: "%",
        944: "W",
        1015: "@",
    }.items()
    for char in chars
}
_OTHER: Final = 650
_WIDE: Final = 1000  # ideographs and the like
_WIDE_FROM: Final = 0x2E80
_RESERVE: Final = 1.06  # other sans-serif fonts run a little wider
_LINE: Final = 1.25  # line height over font size

# An underscore after a single letter, and the one or two characters after it.
SUBSCRIPT_LETTERS: Final = re.compile(
    r"(?<![A-Za-z0-9_].)(?<=[A-Za-z])_([A-Za-z0-9]{1,2})(?![A-Za-z0-9_])"
)


@dataclass(frozen=True)
class TextBlock:
    """Lines of text and the room they take, in px."""

    lines: tuple[str, ...]
    size: float  # font size
    width: float
    height: float

    @property
    def line_height(self) -> float:
        """Distance of the baselines."""
        return self.size * _LINE


NO_TEXT: Final = TextBlock((), 0.0, 0.0, 0.0)


def text_width(text: str, size: float) -> float:
    """Return the width of a line of text in px, a little on the safe side."""
    bare = SUBSCRIPT_LETTERS.sub(r"\1", text)
    units = sum(_WIDTHS.get(char, _WIDE if ord(char) >= _WIDE_FROM else _OTHER) for char in bare)
    return units * size / 1000 * _RESERVE


def typeset(name: str) -> str:
    """Return a name with spaces for its underscores, those of a subscript (``K_p``) excepted."""
    keep = {match.start() for match in SUBSCRIPT_LETTERS.finditer(name)}
    return "".join(
        " " if char == "_" and i not in keep else char for i, char in enumerate(name)
    ).strip()


def wrap(text: str, limit: int) -> tuple[str, ...]:
    """Break text at its spaces into the fewest lines of ``limit`` characters, evenly filled.

    A word longer than the limit keeps its line to itself; line breaks in the text stay.
    """
    lines: list[str] = []
    for paragraph in text.split("\n"):
        words, best = " ".join(paragraph.split()), [""]
        for width in range(limit, 0, -1):
            fill = textwrap.wrap(words, width, break_long_words=False, break_on_hyphens=False)
            if width < limit and len(fill) > len(best):
                break
            best = fill or best
        lines += best
    return tuple(lines)


def text_block(label: str, *, size: float, limit: int) -> TextBlock:
    """Return a label typeset, wrapped and measured; an empty label takes no room."""
    lines = wrap(typeset(label), limit)
    if not any(lines):
        return TextBlock((), size, 0.0, 0.0)
    width = max(text_width(line, size) for line in lines)
    return TextBlock(lines, size, width, len(lines) * size * _LINE)
