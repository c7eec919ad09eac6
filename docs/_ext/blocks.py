"""The project's blocks, as their docstrings describe them."""

import ast
import importlib
import re
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

import yaml

from chamfer.analysis.scenario.field_comments import field_comment
from chamfer.analysis.scenario.scenario_io import value_text

ROOT: Final = Path(__file__).parents[2]
_PORTS: Final = re.compile(r"\.\. pydrake_system::\n\n((?:    .*\n|\n)+)")
_OPTIONAL: Final = re.compile(r", optional\)$")
_ENDINGS: Final = ("Params", "Gains")  # of the names of classes that hold parameters
_RETURNS_A_SYSTEM: Final = re.compile(r"\b(Diagram|LinearSystem)\b")


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A field of a block's parameters."""

    name: str
    default: str  # as ``--set`` takes it; "" for one that has to be given
    unit: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class Block:
    """A class that is a Drake system, or a function that returns one."""

    name: str
    module: str
    signature: str
    text: str  # the docstring without its ports, reStructuredText
    source: str  # what the module says of where it is from
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[tuple[str, tuple[Parameter, ...]], ...]  # by the name of their class
    is_class: bool

    @property
    def path(self) -> str:
        """Return the dotted path that imports it."""
        return f"{self.module}.{self.name}"


@cache
def blocks(package: str) -> tuple[Block, ...]:
    """Return the public blocks of a package such as ``chamfer.systems.servo``, by name."""
    folder = ROOT.joinpath(*package.removeprefix("chamfer.").split("."))
    found = [
        block
        for path in sorted(folder.glob("*.py"))
        for block in _of_module(f"{package}.{path.stem}", path)
    ]
    return tuple(sorted(found, key=lambda block: (not block.is_class, block.name.lower())))


def rooms(storey: str) -> list[str]:
    """Return the subject folders of ``systems`` or ``diagrams`` as packages."""
    return [
        f"chamfer.{storey}.{folder.parent.name}"
        for folder in sorted((ROOT / storey).glob("*/__init__.py"))
    ]


def parameters_of(cls: type[Any]) -> tuple[Parameter, ...]:
    """Return the fields of a dataclass."""
    found = []
    for field in fields(cls):
        default = "" if field.default is MISSING else field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        comment = field_comment(cls, field.name)
        if is_dataclass(default):
            text = f"{type(default).__name__}()"
        else:
            text = default if default == "" else value_text(default)
        found.append(
            Parameter(name=field.name, default=text, unit=comment.unit, meaning=comment.meaning)
        )
    return tuple(found)


def _of_module(module: str, path: Path) -> Iterator[Block]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    source = ast.get_docstring(tree) or ""
    for node in tree.body:
        if not isinstance(node, ast.ClassDef | ast.FunctionDef) or node.name.startswith("_"):
            continue
        text = ast.get_docstring(node) or ""
        if isinstance(node, ast.ClassDef):
            if not _PORTS.search(text):
                continue
        elif not (
            node.name.startswith("make_")
            and node.returns is not None
            and _RETURNS_A_SYSTEM.search(ast.unparse(node.returns))
        ):
            continue
        yield _block(module, node, text, source)


def _block(module: str, node: ast.ClassDef | ast.FunctionDef, text: str, source: str) -> Block:
    found = getattr(importlib.import_module(module), node.name)
    is_class = isinstance(node, ast.ClassDef)
    make = _constructor(node) if isinstance(node, ast.ClassDef) else node
    ports = yaml.safe_load(match[1]) if (match := _PORTS.search(text)) else {}
    return Block(
        name=node.name,
        module=module,
        signature="" if make is None else _signature(make, is_method=is_class),
        text=_PORTS.sub("", text),
        source=source,
        inputs=tuple(_port(one) for one in ports.get("input_ports") or ()),
        outputs=tuple(_port(one) for one in ports.get("output_ports") or ()),
        parameters=tuple(_parameters(found.__init__ if is_class else found)),
        is_class=is_class,
    )


def _constructor(node: ast.ClassDef) -> ast.FunctionDef | None:
    return next(
        (one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"),
        None,
    )


def _signature(make: ast.FunctionDef, *, is_method: bool) -> str:
    """Return the names and defaults, without types: those stand in the text."""
    arguments = make.args
    for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs):
        one.annotation = None
    if arguments.vararg is not None:
        arguments.vararg.annotation = None
    names = ast.unparse(arguments)
    return f"({names.removeprefix('self').removeprefix(', ') if is_method else names})"


def _port(said: str) -> str:
    return _OPTIONAL.sub(") (optional)", said)


def _parameters(make: Any) -> Iterator[tuple[str, tuple[Parameter, ...]]]:
    """Yield the parameter classes of a constructor; a scenario's fields are listed elsewhere."""
    hints = get_type_hints(make)
    hints.pop("return", None)
    waiting = [kind for hint in hints.values() for kind in _parameter_types(hint)]
    seen: set[type[Any]] = set()
    while waiting:
        kind = waiting.pop(0)
        if kind not in seen:
            seen.add(kind)
            yield kind.__name__, parameters_of(kind)
            inner = get_type_hints(kind).values()
            waiting += [one for hint in inner for one in _parameter_types(hint)]


def _parameter_types(hint: Any) -> Iterator[type[Any]]:
    """Yield the parameter classes in a type, such as that in ``tuple[AxisParams, ...] | None``."""
    if isinstance(hint, type) and is_dataclass(hint) and hint.__name__.endswith(_ENDINGS):
        yield hint
    for part in get_args(hint):
        yield from _parameter_types(part)
