"""What recordings of real robots show, and how close the simulator and its observers come."""

from functools import partial
from typing import Final

from chamfer.analysis.published.rows import Row, at_least, at_most, between, near, of
from chamfer.analysis.report.checks import Published

TITLE: Final = "Recordings of real robots"

_TOLD: Final = "the observer is told what half of table_a shows"


# fmt: off
def _slide(name: str) -> tuple[Row, ...]:
    """Return what is asked on a slide of the table."""
    source = f"{name}, a KUKA iiwa on a table"
    return tuple(partial(row, kind="measured") for row in (
        at_least(f"{name}.adaptive.coverage", 95.0, "%", source,
                 f"of the errors within 3 standard deviations; {_TOLD}"),
        at_most(f"{name}.rms_ratio", 1.5, "", source,
                f"rms error of the adaptive observer over the thesis'; {_TOLD}"),
        at_most(f"{name}.adaptive.pulls", 0.0, "%", source,
                "of the samples with a force into the estimated surface, which can't pull"),
        at_most(f"{name}.adaptive.unfit", 0.0, "%", source, _TOLD),
        near(f"{name}.touch", 2.0, 0.05, "s", source, "recordings are cut 2 s before contact"),
    ))


_CUBE: Final = "tosses of a cube, DAIRLab/dair_pll, contactnets_cube"
_LAGGED: Final = "friction is bounded by the impulse expected before a stiff part is stopped"


def _toss(setting: str, note: str = "") -> tuple[Row, ...]:
    """Return what is asked of a setting on the tosses that nothing was fitted on."""
    return tuple(partial(row, kind="measured") for row in (
        between(f"{setting}.travel", 90.0, 110.0, "%", _CUBE, note),
        at_most(f"{setting}.position", 25.0, "%", _CUBE, note),
    ))


PUBLISHED: Final[tuple[Published, ...]] = (
    *of("measured-slide",
        *_slide("table_a"), *_slide("table_b"), *_slide("table_press"),
        at_most("free.false_alarms", 0.0, "", "free, the same arm in the air",
                "contacts detected in free motion", kind="measured")),
    *of("measured-toss",
        *_toss("drake", _LAGGED), *_toss("insertion", _LAGGED), *_toss("connectors"),
        *_toss("similar"), *_toss("similar.fitted"),
        at_least("similar.same_face", 70.0, "%", _CUBE, kind="measured"),
        between("connectors.rebound", -5.0, 5.0, "%", _CUBE,
                "20 s/m, assumed, swallows more than the board; 3 s/m fits", kind="measured")),
)
# fmt: on
