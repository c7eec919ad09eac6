"""Digests of everything a trial's result depends on: function, task, code and machine."""

import enum
import hashlib
import platform
import sys
from collections.abc import Callable, Mapping
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
    """The computing environment: any difference may change a result's last digits, or more."""

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
        TypeError: If the value is not made of plain data, arrays, enumerations, paths,
            dataclasses, and functions or classes of a module's top level.
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
    if isinstance(value, partial):
        parts = [canonical(one) for one in (value.func, value.args, value.keywords)]
        return f"partial({', '.join(parts)})"
    if is_dataclass(value):
        parts = [f"{one.name}={canonical(getattr(value, one.name))}, " for one in fields(value)]
    elif isinstance(value, tuple | list):
        parts = [f"{canonical(one)}, " for one in value]
    elif isinstance(value, Mapping):
        parts = sorted(f"{canonical(key)}: {canonical(of)}, " for key, of in value.items())
    elif isinstance(value, set | frozenset):
        parts = sorted(f"{canonical(one)}, " for one in value)
    else:
        raise TypeError(f"a trial can't depend on {value!r}, which is a {type(value).__name__}")
    return f"{_name(type(value))}({''.join(parts)})"


def _name(value: Any) -> str:
    name = f"{value.__module__}.{value.__qualname__}"
    if "<" in name:
        raise TypeError(f"a trial can't depend on {name}, allowed: one of a module's top level")
    return name


def _sources_digest(modules: tuple[str, ...]) -> str:
    files = [path for package in _PACKAGES for path in _sources(_ROOT / package)]
    for top in sorted({module.partition(".")[0] for module in modules} - {"chamfer"}):
        # Somebody's own package or module; a built-in one has no file.
        own = sys.modules.get(top)
        folders, file = getattr(own, "__path__", None), getattr(own, "__file__", None)
        if folders is not None:
            files += [path for folder in folders for path in _sources(Path(folder))]
        elif file is not None:
            files.append(Path(file))
    lines = [
        f"{path.parent.name}/{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        for path in files
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in _ENDINGS)
