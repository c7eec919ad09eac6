"""Perturbs each field of an experiment in turn and checks whether anything changes."""

import hashlib
import json
import math
import re
import signal
import time
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import islice
from types import FrameType, NoneType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np

from chamfer.analysis.audit.contexts import Context
from chamfer.analysis.campaign.campaign import try_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.command.scenario_fields import Leaf, leaves
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Entry, Outcome, Progress, load
from chamfer.analysis.scenario.scenario_io import make_scenario, value_text
from chamfer.models.validation import ParameterError

_SEED: Final = 0
_LONGEST: Final = 5.0  # times what the unperturbed run takes, then a perturbed one is given up
_LEAST: Final = 120.0  # s, that it has in any case: compiling may take most of it

# Mild ones first: they are the least likely to be refused or to end the run early. A bound that
# is out of reach is told only by the strong ones.
_FACTORS: Final = (1.1, 0.9, 0.5, 2.0, 0.1, 10.0, 0.01, -1.0)
_INSTEAD_OF_ZERO: Final = (0.01, -0.1, 0.1, 1.0, 10.0)
_ALONE: Final = 2  # values of an element while the others stay
_INSTEAD_OF_INFINITY: Final = (1.0, 0.01, 100.0)
_UNKNOWN: Final[dict[Any, tuple[Any, ...]]] = {  # where a value is None
    bool: (False, True),
    int: (1, 2, 10),
    float: (1.0, 0.1, 0.01, 0.001, 10.0),
}

# As in a command: what is said in one line. The last is what Drake makes of failed assertions.
_REFUSALS: Final = (
    *(UserError, ExperimentError, ParameterError),
    *(OverflowError, MemoryError, SystemExit),
)
CRASH: Final = "traceback:"

Kind = Literal["effective", "bounds", "silent", "undecided", "refused"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)  # the weightiest first


@dataclass(frozen=True, kw_only=True)
class Base:
    """The experiment around which a field is perturbed: at reduced size, in a context or not."""

    entry: Entry
    settings: tuple[tuple[str, ...], ...]  # groups of path=value, each over those before it
    in_context: bool = False

    def scenario(self) -> Any:
        """Return the scenario; a context may need more than one step to exist."""
        scenario = load(self.entry).default
        for settings in self.settings:
            scenario = make_scenario(scenario, settings=settings)
        return scenario


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The measurements of a base without perturbation."""

    # A digest of each metric and column, None for what comes out differently each time, as wall
    # times do.
    measured: Mapping[str, str | None]
    seconds: float = 0.0

    def differs(self, measured: Mapping[str, str]) -> bool:
        """Return whether a run measured anything else."""
        unstable = {name for name, one in self.measured.items() if one is None}
        names = (self.measured.keys() | measured.keys()) - unstable
        return any(self.measured.get(name) != measured.get(name) for name in names)


@dataclass(frozen=True, kw_only=True)
class FieldTask:
    """A field, and the bases around which it is perturbed until something changes."""

    entry: Entry
    path: str
    bases: tuple[Base, ...]


@dataclass(frozen=True, kw_only=True)
class FieldVerdict:
    """The result of auditing a field."""

    experiment: str
    path: str
    tried: tuple[tuple[Kind, str], ...]  # path=value, and what came of it
    seconds: float  # of the processor

    @property
    def kind(self) -> Kind:
        """The verdict of the most significant perturbation of the field.

        It is effective if one changed a measurement. Else it bounds if one was refused because of
        another field. It is silent if one ran. It is undecided if those that ran took too long or
        ended with a traceback, or if no context allows it. It is refused if all were.
        """
        return min((kind for kind, _ in self.tried), key=KINDS.index, default="refused")


class _TooLongError(BaseException):
    """A run was stopped; not an Exception, so that no campaign counts it as a failed trial."""


def audit(
    entries: Sequence[Entry],
    progress: Progress,
    *,
    contexts: Sequence[Context] = (),
    settings: Sequence[str] = (),
) -> list[FieldVerdict]:
    """Return the verdict on each leaf of each experiment, in the contexts where fields act.

    The settings override those that reduce an experiment's size.

    Raises:
        UserError: If an experiment doesn't run unperturbed.
    """
    tasks = []
    for entry in entries:
        plain = Base(entry=entry, settings=(entry.reduced, tuple(settings)))
        try:
            scenario = plain.scenario()
        except UserError as error:
            raise UserError(f"{entry.name} can't be reduced: {error}") from error
        for leaf in leaves(scenario):
            bases = _bases(plain, leaf, contexts)
            tasks.append(FieldTask(entry=entry, path=leaf.path, bases=bases))
    found = try_each(audit_field, tasks, progress)
    rows: dict[FieldTask, Row] = dict(zip(found.tasks, found.rows, strict=True))
    for task, failure in found.failed:
        if failure.refused:
            raise UserError(failure.reason)
        crash = [("undecided", f"{CRASH} {failure.reason}")]  # it took the process along
        rows[task] = {"tried": json.dumps(crash), "seconds": 0.0}
    return [
        FieldVerdict(
            experiment=task.entry.name,
            path=task.path,
            tried=tuple((kind, what) for kind, what in json.loads(rows[task]["tried"])),
            seconds=rows[task]["seconds"],
        )
        for task in tasks
    ]


def audit_field(task: FieldTask) -> Row:
    """Return all attempts on a field, ``tried``, as JSON, and the ``seconds`` of a verdict.

    It is perturbed in every way, around every base, until something changes.

    Raises:
        UserError: If the experiment doesn't run unperturbed.
    """
    started = time.process_time()
    tried: list[tuple[Kind, str]] = []
    references = {base: one for base in task.bases if (one := _reference(base))}
    if not references:
        tried.append(("undecided", "no context allows it"))
    ways = ((base, setting) for base in references for setting in _perturbed(base, task.path))
    for base, setting in ways:
        kind, what = _try(base, setting, references[base])
        tried.append((kind, f"{setting}: {what}"))
        if kind == "effective":
            break
    return {"tried": json.dumps(tried), "seconds": time.process_time() - started}


@cache
def _reference(base: Base) -> Reference | None:
    """Run a base unperturbed, twice; None for a context that an experiment refuses."""
    started = time.perf_counter()
    try:
        first, second = (_run(base.scenario(), base.entry) for _ in range(2))
    except _REFUSALS as error:
        if base.in_context:
            return None
        raise UserError(f"{base.entry.name} doesn't run: {error}") from error
    stable = {name: one if one == second.get(name) else None for name, one in first.items()}
    return Reference(measured=stable, seconds=(time.perf_counter() - started) / 2)


def digests(outcome: Outcome) -> dict[str, str]:
    """Return a digest of all measurements of a run, by name, without the simulated time."""
    plain: dict[str, object] = {f"metric {name}": one for name, one in outcome.metrics.items()}
    for title, table in {"": outcome.traces, **outcome.tables}.items():
        for name, column in table.items():
            values = np.asarray(column)
            contents = values.tolist() if values.dtype.hasobject else values.tobytes()
            plain[f"column {title}.{name}"] = (values.dtype.str, values.shape, contents)
    return {name: hashlib.sha256(repr(one).encode()).hexdigest() for name, one in plain.items()}


def _bases(plain: Base, leaf: Leaf, contexts: Sequence[Context]) -> tuple[Base, ...]:
    """Return a leaf's contexts, and last of all none."""
    # Makes a leaf below a null exist; refused if that needs more than defaults.
    given = () if leaf.above is None else ((f"{leaf.above}={{}}",),)
    last = replace(plain, settings=plain.settings + given, in_context=leaf.above is not None)
    found = []
    for context in contexts:
        if context.holds_for(plain.entry.name, leaf.path):
            settings = context.settings_for(leaf.path)
            sets = any(setting.partition("=")[0] == leaf.above for setting in settings)
            groups = (settings,) if sets else (*given, settings)
            found.append(replace(plain, settings=plain.settings + groups, in_context=True))
    return (*found, last)


def _perturbed(base: Base, path: str) -> Iterator[str]:
    """Yield settings of the field that differ from its value."""
    scenario = base.scenario()
    (leaf,) = (one for one in leaves(scenario) if one.path == path)
    resolved = {one.path: one.value for one in leaves(load(base.entry).resolve(scenario))}
    for value in perturbations(leaf.value, leaf.kind, resolved.get(path)):
        yield f"{path}={value_text(value)}"


def _try(base: Base, setting: str, reference: Reference) -> tuple[Kind, str]:
    """Return the kind of result of a perturbation, and the same in words."""
    limit = max(_LEAST, _LONGEST * reference.seconds)
    try:
        scenario = make_scenario(base.scenario(), settings=[setting])
        with _at_most(limit):
            found = _run(scenario, base.entry)
    except _REFUSALS as error:
        message = " ".join(str(error).split())
        kind: Kind = "refused" if _is_about(message, setting) else "bounds"
        return kind, message
    except _TooLongError:
        return "undecided", f"given up after {limit:.0f} s"
    except Exception as error:
        return "undecided", f"{CRASH} {traceback.format_exception_only(error)[-1].strip()}"
    return ("effective", "a change") if reference.differs(found) else ("silent", "no change")


def _is_about(refusal: str, setting: str) -> bool:
    """Return whether a refusal is about the field itself, not about limits of others."""
    named, said, _ = refusal.partition(" is ")
    name = setting.partition("=")[0].rpartition(".")[2]
    return not said or re.sub(r"\[[0-9]+\]", "", named).rpartition(".")[2] == name


def _run(scenario: Any, entry: Entry) -> dict[str, str]:
    experiment = load(entry)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return digests(experiment.run(experiment.resolve(scenario), _SEED, lambda *_, **__: None))


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Stop code that takes longer; only in a process's main thread."""

    def give_up(number: int, frame: FrameType | None) -> None:
        raise _TooLongError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def perturbations(value: Any, kind: Any, resolved: Any) -> Iterator[Any]:
    """Yield values other than a field's, as YAML would give them; not all need be allowed.

    Its ``kind`` gives its type where the value doesn't; ``resolved`` is its value in a run, which
    differs where None is derived.
    """
    seen = [list(value) if isinstance(value, tuple) else value]
    for candidate in _candidates(value, kind, resolved):
        if candidate not in seen:
            seen.append(candidate)
            yield candidate


def _candidates(value: Any, kind: Any, resolved: Any) -> Iterator[Any]:
    choices = get_args(kind)
    if value is None:
        if resolved is not None:
            yield from _candidates(resolved, kind, resolved)
        for choice in choices:
            yield from _values_of(choice)
    elif is_dataclass(value):
        yield None  # a leaf only if it may be
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1, 2 * value, value // 5, value + 5)
    elif isinstance(value, float):
        if value == 0:
            yield from _INSTEAD_OF_ZERO
        elif math.isinf(value):
            yield from (math.copysign(one, value) for one in _INSTEAD_OF_INFINITY)
        else:
            yield from (factor * value for factor in _FACTORS)
    elif isinstance(value, tuple):
        # All elements together, then one at a time, then other lengths.
        yield from map(list, zip(*(_candidates(x, type(x), x) for x in value), strict=False))
        for i, x in enumerate(value):
            for candidate in islice(_candidates(x, type(x), x), _ALONE):
                yield [*value[:i], candidate, *value[i + 1 :]]
        yield from (list(value[:-1]), [*value, *value[-1:]])
        if not value:
            yield from ([0], [1], [0.01])
    else:
        yield from _values_of(kind)
    if value is not None and NoneType in choices:
        yield None


def _values_of(kind: Any) -> Iterator[Any]:
    """Yield values of a type of which none is known."""
    if get_origin(kind) is Literal:
        yield from get_args(kind)
    elif kind in _UNKNOWN:
        yield from _UNKNOWN[kind]
    elif get_origin(kind) is tuple:
        of = get_args(kind)
        for length in (1, 2, 3, 6, 7) if of[-1] is Ellipsis else [len(of)]:
            yield from ([one] * length for one in _values_of(of[0]))
    elif is_dataclass(kind):  # a mapping of the fields without a default
        hints = get_type_hints(kind)
        required = [one.name for one in fields(kind) if one.default is one.default_factory]
        if not required:
            yield {}
        for values in zip(*(_values_of(hints[name]) for name in required), strict=False):
            yield dict(zip(required, values, strict=True))
