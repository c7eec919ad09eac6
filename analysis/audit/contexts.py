"""Where fields act that do nothing by default, and which fields may do nothing.

Paths are patterns of :mod:`fnmatch`, where ``*`` stands for any text.
"""

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final


@dataclass(frozen=True, kw_only=True)
class Context:
    """Settings with which a field acts."""

    path: str
    settings: tuple[str, ...]  # path=value
    reason: str
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and fnmatchcase(path, self.path)


@dataclass(frozen=True, kw_only=True)
class Exemption:
    """A field that changes nothing and is right to."""

    path: str
    reason: str
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and fnmatchcase(path, self.path)


CONTEXTS: Final[tuple[Context, ...]] = ()
EXEMPTIONS: Final[tuple[Exemption, ...]] = ()
