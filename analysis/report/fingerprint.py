"""What a trial's result depends on, as digests: its function and task, the code, the machine."""

import enum
import hashlib
import platform
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path, PurePath
from types import BuiltinFunctionType, FunctionType
from typing import Any, Final

import numpy as np

_ROOT: Final = Path(__file__).parents[2]
_PACKAGES: Final = ("models", "systems", "diagrams", "analysis")
_ENDINGS: Final = (".py", ".urdf")
_DISTRIBUTIONS: Final = ("drake", "numpy", "scipy", "numba", "opencv-python-headless")


@dataclass(frozen=True, kw_only=True)
class Code:
    """What computes: any difference may change a result's last digits, or more."""

    sources: str  # digest of the project's files, and of those that the function comes from
    versions: tuple[tuple[str, str], ...]

    def differs(self, other: "Code") -> str | None:
        """Return in a few words what the other one has differently; None: nothing."""
        if self.sources != other.sources:
            return "the sources"
        for (name, own), (_, its) in zip(self.versions, other.versions, strict=True):
            if own != its:
                return f"{name}, {own} and {its}"
        return None


@cache
def code(modules: tuple[str, ...]) -> Code:
    """Return what functions of modules are computed by, as it was when first asked."""
    versions = [(name, version(name)) for name in _DISTRIBUTIONS]
    return Code(
        sources=_sources_digest(modules),
        versions=(("python", platform.python_version()), *versions),
    )


def modules_of(function: Callable[..., object]) -> tuple[str, ...]:
    """Return the modules of a function, or of what is a partial of one, and of its functions."""
    modules = set()
    while isinstance(function, partial):
        given = (*function.args, *function.keywords.values())
        modules |= {one.__module__ for one in given if isinstance(one, FunctionType)}
        function = function.func
    return tuple(sorted({*modules, function.__module__}))


@cache
def processor() -> str:
    """Return the type of this machine's processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return f"{platform.machine()} {value.strip()}"
    except OSError:
        pass  # not Linux
    return f"{platform.machine()} {platform.processor()}"


def digest(*parts: object) -> bytes:
    """Return a digest of values, the same in every process.

    Raises:
        TypeError: If a value is none of those that have a canonical text.
    """
    return hashlib.sha256("\n".join(map(canonical, parts)).encode()).digest()


def canonical(value: object) -> str:
    """Return a text that only an equal value has.

    Raises:
        TypeError: If the value is not made of numbers, texts, booleans, None, tuples, lists,
            mappings, sets, ranges, arrays, enumerations, paths, dataclasses, and functions or
            classes of a module's top level.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, enum.Enum):
        return f"{_name(type(value))}.{value.name}"
    if value is None or isinstance(value, bool | int | float | str | bytes | range | PurePath):
        return repr(value)
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        content = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"array({value.dtype.str}, {value.shape}, {content})"
    if isinstance(value, type | FunctionType | BuiltinFunctionType):
        return _name(value)
    return "".join(_composed(value))


def _composed(value: object) -> Iterator[str]:
    if is_dataclass(value):
        yield from (_name(type(value)), "(")
        for field in fields(value):
            yield f"{field.name}={canonical(getattr(value, field.name))}, "
    elif isinstance(value, partial):
        yield f"partial({canonical(value.func)}, {canonical(value.args)}, "
        yield canonical(value.keywords)
    elif isinstance(value, tuple | list):
        yield f"{_name(type(value))}("
        for element in value:
            yield f"{canonical(element)}, "
    elif isinstance(value, Mapping):
        yield f"{_name(type(value))}("
        yield from sorted(f"{canonical(key)}: {canonical(of)}, " for key, of in value.items())
    elif isinstance(value, set | frozenset):
        yield f"{_name(type(value))}("
        yield from sorted(f"{canonical(element)}, " for element in value)
    else:
        raise TypeError(f"a trial can't depend on {value!r}, which is a {type(value).__name__}")
    yield ")"


def _name(value: Any) -> str:
    name = f"{value.__module__}.{value.__qualname__}"
    if "<" in name:
        raise TypeError(f"a trial can't depend on {name}, allowed: one of a module's top level")
    return name


def _sources_digest(modules: tuple[str, ...]) -> str:
    files = [path for package in _PACKAGES for path in _sources(_ROOT / package)]
    for top in sorted({module.partition(".")[0] for module in modules} - {"chamfer"}):
        files += _own_sources(top)
    lines = [
        f"{path.parent.name}/{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        for path in files
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _own_sources(top: str) -> list[Path]:
    """Return the files of a package or module of somebody's own; none if it has no file."""
    found = sys.modules.get(top)
    folders = getattr(found, "__path__", None)
    if folders is not None:
        return [path for folder in folders for path in _sources(Path(folder))]
    file = getattr(found, "__file__", None)
    return [] if file is None else [Path(file)]


def _sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in _ENDINGS)
