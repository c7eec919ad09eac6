"""Writes laws in C99 by the templates next to them.

A law of ``pid_law.py`` is written by ``pid_law.c.jinja`` in the same folder; its functions and
files are named ``pid``. The template holds the C of that law alone:

- ``title``: one sentence on the law.
- ``dimension``: the name of the first input's size, which others have too.
- ``scalars``: signals of one element that are no arrays.
- ``about``: meanings of inputs and outputs, beside their units.
- ``missing``: the value that stands for a missing optional input, 0 by default.
- ``refusals``: the statuses but OK that a step returns, each with its cause.
- ``state()``: the members of the state. ``code()``: constants and functions.
"""

import inspect
import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from chamfer.analysis.drawing.graph import unique
from chamfer.analysis.scenario.field_comments import field_comment
from chamfer.systems.exact_discretisation import blocks
from chamfer.systems.law import HeldLaw, Signal
from chamfer.systems.law_block import LawBlock

if TYPE_CHECKING:
    from pydrake.systems.framework import System

_WIDTH: Final = 99
_NOT_PLAIN: Final = re.compile(r"[^ -~]|(?<=\*)/|(?<=/)\*|\?(?=\?)|\\$")


@dataclass(frozen=True, kw_only=True)
class Element:
    """One number of a law's inputs or outputs."""

    name: str  # error, or error[1] of several
    member: str  # of the struct in C
    causality: str  # input or output
    unit: str
    meaning: str
    start: float  # before anything is read or given
    flag: str  # the member that says whether it is there, "" if it always is


@dataclass(frozen=True)
class LawInC:
    """A law that can be written in C."""

    name: str  # of its functions and files
    law: Any
    origin: tuple[str, ...] = ()  # lines on what it is made of, for the head of each file

    def files(self) -> dict[str, str]:
        """Return header and source by name."""
        return {
            f"{self.name}.h": self.render("law.h.jinja"),
            f"{self.name}.c": f"{self.head}\n{self.form.code()}",
        }

    def render(self, template: str, **values: Any) -> str:
        """Render a template of this folder for the law."""
        own = {"form": self.form, "head": self.head, "members": self._members}
        text = _environment(Path(__file__).parent).get_template(template)
        return text.render(self._values | own | values)

    @property
    def elements(self) -> Iterator[Element]:
        """All elements of the inputs, then of the outputs, in order."""
        start = self.law.command(self.law.start())._asdict()
        signals: Mapping[str, Mapping[str, Signal]] = {
            "input": self.law.inputs,
            "output": self.law.outputs,
        }
        for causality, some in signals.items():
            for name, signal in some.items():
                missing = self.form.missing.get(name, 0.0)
                begin = start[name] if causality == "output" else [missing] * signal.size
                for i, unit in enumerate(signal.units):
                    yield Element(
                        name=name if signal.size == 1 else f"{name}[{i + 1}]",
                        member=name if name in self.form.scalars else f"{name}[{i}]",
                        causality=causality,
                        unit=unit,
                        meaning=self.form.about.get(name, ""),
                        start=float(begin[i]),
                        flag=f"has_{name}" if signal.optional else "",
                    )

    @cached_property
    def form(self) -> Any:
        """The content of the law's own template."""
        path = template_of(self.law)
        assert path is not None
        return _environment(path.parent).get_template(path.name).make_module(self._values)

    @property
    def head(self) -> str:
        """The comment at the top of each file."""
        text = (
            "No allocation, no library but <math.h>. Compiled without contraction of products and",
            "sums (gcc and clang: -ffp-contract=off) and without -ffast-math, it answers to the",
            "last bit as the law that was simulated. Parameters are constants: to change one,",
            "export again.",
            "SPDX-License-Identifier: BSD-3-Clause",
        )
        made = (line for one in self.origin for line in textwrap.wrap(_plain(one), _WIDTH - 3))
        lines = (str(self.form.title), "", *made, "", *text)
        return "/* " + "\n".join(f"   {line}".rstrip() for line in lines).lstrip() + " */"

    @property
    def _values(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "NAME": self.name.upper(),
            "law": self.law,
            "params": getattr(self.law, "params", None),
            "size": next(iter(self.law.inputs.values())).size,
            "constant": self._constant,
        }

    def _members(self, signals: Mapping[str, Signal]) -> Iterator[str]:
        size = self._values["size"]
        for name, signal in signals.items():
            if signal.optional:
                yield f"bool has_{name};"
            named = f"{self.name}_{self.form.dimension}".upper()
            extent = f"[{named if signal.size == size else signal.size}]"
            extent = "" if name in self.form.scalars else extent
            units = dict.fromkeys(filter(None, signal.units))
            said = ", ".join(filter(None, (" and ".join(units), self.form.about.get(name, ""))))
            yield _remarked(f"double {name}{extent};", said, indent=4)

    def _constant(self, field: str, extent: str = "") -> str:
        """Return a parameter as a constant; ``axes.limit`` is an array of all axes."""
        owner, _, name = field.rpartition(".")
        of = getattr(self.law.params, owner) if owner else self.law.params
        value = [getattr(one, name) for one in of] if owner else getattr(of, name)
        said = field_comment(type(of[0] if owner else of), name)
        comment = ", ".join(filter(None, (said.unit, said.meaning)))
        code = f"static const double {name.upper()}{extent} = {in_c(value)};"
        return _remarked(code, comment, indent=0)


def laws_in_c(diagram: "System", origin: Sequence[str] = ()) -> list[LawInC]:
    """Return the laws of a diagram's blocks that can be written in C."""
    found, taken = [], set[str]()
    for block in blocks(diagram):
        if isinstance(block, LawBlock) and (path := template_of(block.law)) is not None:
            name = unique(path.name.removesuffix("_law.c.jinja"), taken, "_")
            where = f"Block: {block.GetSystemPathname().strip(':')}"
            found.append(LawInC(name, block.law, (*origin, where)))
    return found


def template_of(law: Any) -> Path | None:
    """Return the template in C next to a law, None if there is none."""
    file = getattr(inspect.getmodule(type(law)), "__file__", None)
    if file is None or not isinstance(law, HeldLaw):
        return None
    path = Path(file).with_suffix(".c.jinja")
    return path if path.exists() else None


def in_c(value: Any) -> str:
    """Return a number, or numbers in rows, as C writes them."""
    if hasattr(value, "__len__"):
        return f"{{{', '.join(map(in_c, value))}}}"
    number = float(value)
    return repr(number) if math.isfinite(number) else f"{'-' * (number < 0)}INFINITY"


def _remarked(code: str, remark: str, *, indent: int) -> str:
    """Return code with a comment after it, or before it where the line would be too long."""
    if not remark:
        return code
    comment = f"/* {_plain(remark)} */"
    line = f"{code} {comment}"
    return line if len(line) + indent <= _WIDTH else f"{comment}\n{' ' * indent}{code}"


def _plain(text: str) -> str:
    """Return a text that C can have in a comment."""
    return _NOT_PLAIN.sub(" ", text)


def _environment(folder: Path) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=lambda name: name is not None and ".xml" in name,
    )
    environment.filters["c"] = in_c
    return environment
