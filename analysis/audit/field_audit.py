"""Perturbs one field of an experiment after the other and looks whether anything changes."""

import hashlib
import math
import re
import signal
import time
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from itertools import islice
from types import FrameType, NoneType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.audit.contexts import Context
from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.command.scenario_fields import Leaf, leaves
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Entry, Outcome, Progress, load
from chamfer.analysis.scenario.scenario_io import make_scenario, value_text
from chamfer.models.validation import ParameterError

_SEED: Final = 0
_LONGEST: Final = 5.0  # times what the unperturbed run takes, then a perturbed one is given up
_LEAST: Final = 120.0  # s, that it has in any case: compiling may take most of it
_REFERENCES: Final = 0.1  # of the audit, for the progress

# Mild ones first: they are the least likely to be refused or to end the run early. A bound that
# is out of reach is told only by the strong ones.
_FACTORS: Final = (1.1, 0.9, 0.5, 2.0, 0.1, 10.0, 0.01, -1.0)
_INSTEAD_OF_ZERO: Final = (0.01, -0.1, 0.1, 1.0, 10.0)
_ALONE: Final = 2  # values of an element while the others stay
_INSTEAD_OF_INFINITY: Final = (1.0, 0.01, 100.0)

# As in a command: what is said in one line. The last is what Drake makes of failed assertions.
_REFUSALS: Final = (
    UserError,
    ExperimentError,
    ParameterError,
    OverflowError,
    MemoryError,
    SystemExit,
)
_CRASH: Final = "traceback:"

Kind = Literal["effective", "bounds", "silent", "undecided", "refused"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)  # the weightiest first


@dataclass(frozen=True, kw_only=True)
class Base:
    """What a field is perturbed around: an experiment at reduced size, in a context or not."""

    entry: Entry
    settings: tuple[tuple[str, ...], ...]  # groups of path=value, each over those before it
    in_context: bool = False


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What a base measures unperturbed, and what of that comes out differently each time.

    Wall times do; nothing else should.
    """

    measured: Mapping[str, str]  # digest of each metric and column; none if the base is refused
    unstable: frozenset[str] = frozenset()
    seconds: float = 0.0

    def differs(self, measured: Mapping[str, str]) -> bool:
        """Whether a run measured anything else."""
        names = (self.measured.keys() | measured.keys()) - self.unstable
        return any(self.measured.get(name) != measured.get(name) for name in names)


@dataclass(frozen=True, kw_only=True)
class FieldTask:
    """A field, and the bases around which it is perturbed until something changes."""

    entry: Entry
    path: str
    bases: tuple[tuple[Base, Reference], ...]


@dataclass(frozen=True, kw_only=True)
class FieldVerdict:
    """What came of a field.

    It is effective if a perturbation changed what is measured. Else it bounds if one was refused
    for the sake of another field; it is silent if one ran, undecided if those that ran took too
    long or ended with a traceback, or if no context allows it, and refused if all were.
    """

    experiment: str
    path: str
    kind: Kind
    tried: tuple[str, ...]  # path=value, and what came of it
    said: str  # the one among them that shows what it is
    crashes: tuple[str, ...]  # those that ended with a traceback
    seconds: float  # of the processor


class _TooLongError(BaseException):
    """A run was given up; not an Exception, so that no campaign takes it for a failed trial."""


def audit(
    entries: Sequence[Entry],
    progress: Progress,
    *,
    contexts: Sequence[Context] = (),
    settings: Sequence[str] = (),
) -> list[FieldVerdict]:
    """Return what comes of each leaf of each experiment.

    Args:
        entries: The experiments.
        progress: Told how far the audit is.
        contexts: Where fields act.
        settings: ``path=value``, over those that reduce an experiment's size.

    Raises:
        UserError: If an experiment doesn't run unperturbed.
    """
    plans = {}
    for entry in entries:
        plain = Base(entry=entry, settings=(entry.reduced, tuple(settings)))
        try:
            scenario = _scenario(plain)
        except UserError as error:
            raise UserError(f"{entry.name} can't be reduced: {error}") from error
        for leaf in leaves(scenario):
            plans[entry, leaf.path] = _bases(plain, leaf, contexts)
    bases = list(dict.fromkeys(base for plan in plans.values() for base in plan))
    found = run_each(
        measure,
        bases,
        lambda fraction, doing="": progress(_REFERENCES * fraction, f"unperturbed: {doing}"),
    )
    for _, failure in found.failed:
        raise UserError(failure.reason)
    references = dict(zip(found.tasks, map(_reference, found.rows), strict=True))
    tasks = [
        FieldTask(
            entry=entry,
            path=path,
            bases=tuple((base, references[base]) for base in plan if references[base].measured),
        )
        for (entry, path), plan in plans.items()
    ]
    audited = run_each(
        audit_field,
        tasks,
        lambda fraction, doing="": progress(_REFERENCES + (1 - _REFERENCES) * fraction, doing),
    )
    verdicts = [_verdict(row) for row in audited.rows]
    verdicts += [_failed(task, failure.reason) for task, failure in audited.failed]
    order = {(task.entry.name, task.path): i for i, task in enumerate(tasks)}
    return sorted(verdicts, key=lambda verdict: order[verdict.experiment, verdict.path])


def _reference(row: Row) -> Reference:
    return Reference(
        measured=dict(zip(row["names"].tolist(), row["digests"].tolist(), strict=True)),
        unstable=frozenset(row["unstable"].tolist()),
        seconds=row["seconds"],
    )


def _verdict(row: Row) -> FieldVerdict:
    lists = {name: tuple(row[name].tolist()) for name in ("tried", "crashes")}
    return FieldVerdict(**{**row, **lists})


def _failed(task: FieldTask, reason: str) -> FieldVerdict:
    """Return the verdict on a field whose perturbation took the process along."""
    return FieldVerdict(
        experiment=task.entry.name,
        path=task.path,
        kind="undecided",
        tried=(reason,),
        said=reason,
        crashes=(reason,),
        seconds=0.0,
    )


def measure(base: Base) -> Row:
    """Run a base unperturbed, twice; in a context that an experiment refuses nothing is measured.

    Returns:
        The ``names`` of all that is measured, their ``digests``, those of them that are
        ``unstable``, and how many ``seconds`` a run takes.

    Raises:
        UserError: If it doesn't run.
    """
    started = time.perf_counter()
    try:
        first, second = (_run(_scenario(base), base.entry) for _ in range(2))
    except _REFUSALS as error:
        if base.in_context:
            return {**dict.fromkeys(("names", "digests", "unstable"), _texts(())), "seconds": 0.0}
        raise UserError(f"{base.entry.name} doesn't run: {error}") from error
    return {
        "names": _texts(tuple(first)),
        "digests": _texts(tuple(first.values())),
        "unstable": _texts([name for name in first if first[name] != second.get(name)]),
        "seconds": (time.perf_counter() - started) / 2,
    }


def _texts(values: Sequence[str]) -> NDArray[np.str_]:
    return np.array(values, dtype=np.str_)


def audit_field(task: FieldTask) -> Row:
    """Perturb a field in every way, around every base, until something changes.

    Returns:
        The fields of a :class:`FieldVerdict`.
    """
    started = time.process_time()
    kinds: list[Kind] = [] if task.bases else ["undecided"]
    tried: list[str] = []
    crashes: list[str] = []
    for base, reference in task.bases:
        for setting in _perturbed(base, task.path):
            kind, what = _try(base, setting, reference)
            kinds.append(kind)
            tried.append(f"{setting}: {what}")
            if what.startswith(_CRASH):
                crashes.append(tried[-1])
            if kind == "effective":
                break
        if "effective" in kinds:
            break
    verdict: Kind = next((kind for kind in KINDS if kind in kinds), "refused")
    said = (what for kind, what in zip(kinds, tried, strict=False) if kind == verdict)
    return {
        "experiment": task.entry.name,
        "path": task.path,
        "kind": verdict,
        "tried": _texts(tried),
        "said": next(said, ""),
        "crashes": _texts(crashes),
        "seconds": time.process_time() - started,
    }


def digests(outcome: Outcome) -> dict[str, str]:
    """Return a digest of all that a run measured, by name; how long it simulated is not in it."""
    plain: dict[str, object] = {f"metric {name}": one for name, one in outcome.metrics.items()}
    for title, table in {"": outcome.traces, **outcome.tables}.items():
        for name, column in table.items():
            values = np.asarray(column)
            contents = values.tolist() if values.dtype.hasobject else values.tobytes()
            plain[f"column {title}.{name}"] = (values.dtype.str, values.shape, contents)
    return {name: hashlib.sha256(repr(one).encode()).hexdigest() for name, one in plain.items()}


def _bases(plain: Base, leaf: Leaf, contexts: Sequence[Context]) -> tuple[Base, ...]:
    """Return a leaf's contexts, and last of all none."""
    within = [
        replace(plain, settings=(*plain.settings, *groups), in_context=True)
        for context in contexts
        if context.holds_for(plain.entry.name, leaf.path)
        for groups in [_groups(context.settings_for(leaf.path), leaf)]
    ]
    return (
        *within,
        replace(
            plain,
            settings=(*plain.settings, *_given(leaf)),
            in_context=leaf.above is not None,
        ),
    )


def _groups(settings: tuple[str, ...], leaf: Leaf) -> tuple[tuple[str, ...], ...]:
    """Return a context's settings, and before them what makes the leaf exist unless they do."""
    sets = any(setting.partition("=")[0] == leaf.above for setting in settings)
    return (settings,) if sets else (*_given(leaf), settings)


def _given(leaf: Leaf) -> tuple[tuple[str, ...], ...]:
    """Return what makes a leaf below a null exist; refused if that needs more than defaults."""
    return () if leaf.above is None else ((f"{leaf.above}={{}}",),)


def _scenario(base: Base) -> Any:
    scenario = load(base.entry).default
    for settings in base.settings:
        scenario = make_scenario(scenario, settings=settings)
    return scenario


def _perturbed(base: Base, path: str) -> Iterator[str]:
    """Yield settings of the field that differ from what it is."""
    scenario = _scenario(base)
    (leaf,) = (one for one in leaves(scenario) if one.path == path)
    resolved = {one.path: one.value for one in leaves(load(base.entry).resolve(scenario))}
    for value in perturbations(leaf.value, leaf.kind, resolved.get(path)):
        yield f"{path}={value_text(value)}"


def _try(base: Base, setting: str, reference: Reference) -> tuple[Kind, str]:
    """Return what comes of a perturbation, and the same in words."""
    limit = max(_LEAST, _LONGEST * reference.seconds)
    try:
        scenario = make_scenario(_scenario(base), settings=[setting])
        with _at_most(limit):
            found = _run(scenario, base.entry)
    except _REFUSALS as error:
        message = " ".join(str(error).split())
        kind: Kind = "refused" if _is_about(message, setting) else "bounds"
        return kind, message
    except _TooLongError:
        return "undecided", f"given up after {limit:.0f} s"
    except Exception as error:
        return "undecided", f"{_CRASH} {traceback.format_exception_only(error)[-1].strip()}"
    return ("effective", "a change") if reference.differs(found) else ("silent", "no change")


def _is_about(refusal: str, setting: str) -> bool:
    """Whether a refusal is about the field itself, and not about what others may then be."""
    named, said, _ = refusal.partition(" is ")
    name = setting.partition("=")[0].rpartition(".")[2]
    return not said or re.sub(r"\[[0-9]+\]", "", named).rpartition(".")[2] == name


def _run(scenario: Any, entry: Entry) -> dict[str, str]:
    experiment = load(entry)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return digests(experiment.run(experiment.resolve(scenario), _SEED, _unheard))


def _unheard(fraction: float, doing: str = "") -> None:
    """Let a run report to nobody."""


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Give up what takes longer; only in a process's main thread."""

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
    """Yield values other than ``value``, as YAML would give them; not all need be allowed.

    Args:
        value: What the field is.
        kind: Its type, which says what it could be where the value doesn't.
        resolved: What a run takes it to be; it differs where None is derived.
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
        yield from _numbers(value)
    elif isinstance(value, tuple):
        yield from _tuples(value)
    else:
        yield from _values_of(kind)
    if value is not None and NoneType in choices:
        yield None


def _numbers(value: float) -> Iterator[float]:
    if value == 0:
        yield from _INSTEAD_OF_ZERO
    elif math.isinf(value):
        yield from (math.copysign(one, value) for one in _INSTEAD_OF_INFINITY)
    else:
        yield from (factor * value for factor in _FACTORS)


def _tuples(value: Sequence[Any]) -> Iterator[list[Any]]:
    """Yield lists whose elements are all perturbed, then one at a time, then of other lengths."""
    for together in zip(*(_candidates(one, type(one), one) for one in value), strict=False):
        yield list(together)
    for i, element in enumerate(value):
        for candidate in islice(_candidates(element, type(element), element), _ALONE):
            yield [*value[:i], candidate, *value[i + 1 :]]
    yield list(value[:-1])
    yield [*value, *value[-1:]]
    if not value:
        yield from ([0], [1], [0.01])


def _values_of(kind: Any) -> Iterator[Any]:
    """Yield values of a type of which none is known."""
    if get_origin(kind) is Literal:
        yield from get_args(kind)
    elif kind is bool:
        yield from (False, True)
    elif kind is int:
        yield from (1, 2, 10)
    elif kind is float:
        yield from (1.0, 0.1, 0.01, 0.001, 10.0)
    elif get_origin(kind) is tuple:
        yield from _lists_of(get_args(kind))
    elif is_dataclass(kind):
        yield from _mappings_of(kind)


def _mappings_of(kind: Any) -> Iterator[dict[str, Any]]:
    """Yield mappings that give a dataclass the fields without a default."""
    hints = get_type_hints(kind)
    required = [
        field.name
        for field in fields(kind)
        if field.default is MISSING and field.default_factory is MISSING
    ]
    if not required:
        yield {}
        return
    for values in zip(*(_values_of(hints[name]) for name in required), strict=False):
        yield dict(zip(required, values, strict=True))


def _lists_of(kinds: Sequence[Any]) -> Iterator[list[Any]]:
    lengths = (1, 2, 3, 6, 7) if kinds[-1] is Ellipsis else (len(kinds),)
    for length in lengths:
        for one in _values_of(kinds[0]):
            yield [one] * length
