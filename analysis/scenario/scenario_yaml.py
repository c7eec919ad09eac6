"""YAML for scenarios: safe, with the scalars of YAML 1.2, and no key twice.

PyYAML reads YAML 1.1, where ``1e-3`` is a text, ``1:30`` is 90, ``010`` is 8 and ``off`` is false.
Someone who types a number or a name means the number or the name.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from chamfer.analysis.scenario.errors import UserError

_INT: Final = "[-+]?[0-9]+"
_FLOAT: Final = (
    r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"
    r"|[-+]?\.?(inf|Inf|INF)|\.?(nan|NaN|NAN)"
)
_PLAIN: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_./-]*")  # a text that may need no quotes
_MOST: Final = 10_000  # values and keys of a document, each counted as often as an alias names it
_TAGS: Final = ("null", "str", "seq", "map")  # as PyYAML makes them
_LIKE_TEXT: Final = tuple(f"tag:yaml.org,2002:{one}" for one in ("bool", "int", "float", "null"))
_KINDS: Final = {list: "list", str: "text", int: "number", float: "number"}


class _Loader(yaml.SafeLoader):
    """Reads plain data only; refuses a repeated key and an alias bomb.

    Keys are texts, whatever they look like: a field may be called true.
    """

    def get_single_node(self) -> yaml.Node | None:
        node: yaml.Node | None = super().get_single_node()
        if node is not None:
            _require_few(node)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen and key.value != "<<":
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key {key.value!r} is given twice", key.start_mark
                    )
                seen.add(key.value)
                if key.tag in _LIKE_TEXT:
                    key.tag = "tag:yaml.org,2002:str"
        return super().construct_mapping(node, deep)


_Loader.yaml_implicit_resolvers = {}  # the loader's own, in place of those of YAML 1.1


def _resolve(tag: str, pattern: str, first: list[str]) -> None:
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{tag}", re.compile(f"^(?:{pattern})$"), first
    )


def _require_few(document: yaml.Node) -> None:
    """Refuse a document with too many values and keys, counted once for each alias."""
    inside = [document]
    for _ in range(_MOST):
        if not inside:
            return
        node = inside.pop()
        if isinstance(node, yaml.MappingNode):
            inside += [inner for pair in node.value for inner in pair]
        elif isinstance(node, yaml.SequenceNode):
            inside += node.value
    problem = f"more than {_MOST} values, with each use of an alias counted"
    raise yaml.constructor.ConstructorError(None, None, problem, document.start_mark)


def _text(loader: _Loader, node: yaml.ScalarNode) -> str:
    return str(loader.construct_scalar(node))  # refuses lists and mappings


def _bool(loader: _Loader, node: yaml.ScalarNode) -> bool:
    text = _text(loader, node).lower()
    if text not in ("true", "false"):
        raise ValueError(f"{text!r} is not true or false")
    return text == "true"


def _int(loader: _Loader, node: yaml.ScalarNode) -> int:
    return int(_text(loader, node))


def _float(loader: _Loader, node: yaml.ScalarNode) -> float:
    return float(_text(loader, node).replace(".inf", "inf").replace(".nan", "nan").lower())


_resolve("bool", "true|True|TRUE|false|False|FALSE", list("tTfF"))
_resolve("null", "~|null|Null|NULL|", ["~", "n", "N", ""])
_resolve("merge", "<<", ["<"])
_resolve("int", _INT, list("-+0123456789"))
_resolve("float", _FLOAT, list("-+.0123456789iInN"))
_Loader.yaml_constructors = {  # without those of dates, sets and bytes
    tag: make
    for tag, make in yaml.SafeLoader.yaml_constructors.items()
    if tag is None or tag.rpartition(":")[2] in _TAGS
}
_Loader.add_constructor("tag:yaml.org,2002:bool", _bool)
_Loader.add_constructor("tag:yaml.org,2002:int", _int)
_Loader.add_constructor("tag:yaml.org,2002:float", _float)


def parse_value(text: str) -> Any:
    """Return the value that ``text`` stands for.

    Raises:
        ValueError: If ``text`` is not YAML; the message says what is wrong with it.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise ValueError(f"{line}{error.problem or error.context}") from error
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    except (yaml.YAMLError, LookupError) as error:
        raise ValueError(str(error).splitlines()[0]) from error


def one_line(plain: Any) -> str:
    """Return YAML in one line that reads back as ``plain``, as simple as possible."""
    if isinstance(plain, Mapping):
        return f"{{{', '.join(f'{name}: {one_line(value)}' for name, value in plain.items())}}}"
    if isinstance(plain, list | tuple):
        return f"[{', '.join(map(one_line, plain))}]"
    if isinstance(plain, str):
        can_be_plain = _PLAIN.fullmatch(plain) and parse_value(plain) == plain
        return plain if can_be_plain else _quoted(plain)
    if isinstance(plain, float) and not math.isfinite(plain):
        return str(plain).replace("inf", ".inf")
    return json.dumps(plain)


def block(plain: Mapping[str, Any]) -> str:
    """Return YAML that reads back as ``plain``, with a line for each field."""
    return "".join(f"{line}\n" for line in _lines(plain))


def _lines(plain: Mapping[str, Any]) -> Iterator[str]:
    for name, value in plain.items():
        if isinstance(value, Mapping) and value:
            yield f"{name}:"
            yield from (f"  {line}" for line in _lines(value))
        elif isinstance(value, list | tuple) and any(isinstance(one, Mapping) for one in value):
            yield f"{name}:"
            for one in value:
                fields = isinstance(one, Mapping) and one
                first, *others = _lines(one) if fields else [one_line(one)]
                yield f"- {first}"
                yield from (f"  {line}" for line in others)
        else:
            yield f"{name}: {one_line(value)}"


def _quoted(text: str) -> str:
    line: str = yaml.safe_dump(text, default_style='"', width=math.inf)
    return line.rstrip("\n")


def read_mapping(path: Path, what: str = "scenario fields") -> dict[Any, Any]:
    """Return the mapping that a YAML file holds, of ``what`` for messages.

    Raises:
        UserError: If the file can't be read, is not YAML or holds something else.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not a text in UTF-8") from error
    try:
        content = parse_value(text)
    except ValueError as error:
        raise UserError(f"{path}: {error}") from error
    if not isinstance(content, dict):
        found = "empty" if content is None else f"a {_KINDS.get(type(content), 'single value')}"
        raise UserError(f"{path} is {found}, allowed: a mapping of {what}")
    return content
