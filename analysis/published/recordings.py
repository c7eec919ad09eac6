"""What recordings of real robots show, and how close the simulator and its observers come."""

from functools import partial
from typing import Final

from chamfer.analysis.published.rows import Row, at_least, at_most, between, near, of
from chamfer.analysis.report.checks import Published

TITLE: Final = "Recordings of real robots"

_TOLD: Final = "the observer is told what half of table_a shows"


# fmt: off
_SLIDES: Final = "slides of a KUKA iiwa over a table"

_CUBE: Final = "tosses of a cube, DAIRLab/dair_pll, contactnets_cube"
_LAGGED: Final = "friction is bounded by the impulse expected before a stiff part is stopped"


def _toss(setting: str, note: str = "") -> tuple[Row, ...]:
    """Return what is asked of a setting on the tosses that nothing was fitted on."""
    return tuple(partial(row, kind="measured") for row in (
        between(f"{setting}.travel", 90.0, 110.0, "%", _CUBE, note),
        at_most(f"{setting}.position", 25.0, "%", _CUBE, note),
    ))


PUBLISHED: Final[tuple[Published, ...]] = (
    *of("measured-slide", *(partial(row, kind="measured") for row in (
        at_least("adaptive.coverage", 95.0, "%", _SLIDES,
                 f"of the errors within 3 standard deviations; {_TOLD}"),
        at_most("rms_ratio", 1.5, "", _SLIDES,
                f"rms error of the adaptive observer over the thesis'; {_TOLD}"),
        at_most("adaptive.pulls", 0.0, "%", _SLIDES,
                "of the samples with a force into the estimated surface, which can't pull"),
        at_most("adaptive.unfit", 0.0, "%", _SLIDES, _TOLD),
        *(near(f"{name}.touch", 2.0, 0.05, "s", _SLIDES, "recordings are cut 2 s before contact")
          for name in ("table_a", "table_b", "table_press")),
        at_most("free.false_alarms", 0.0, "", "the same arm in the air",
                "contacts detected in free motion")))),
    *of("measured-toss",
        *_toss("drake", _LAGGED), *_toss("insertion", _LAGGED), *_toss("connectors"),
        *_toss("similar"), *_toss("similar.fitted"),
        at_least("similar.same_face", 70.0, "%", _CUBE, kind="measured"),
        between("connectors.rebound", -5.0, 5.0, "%", _CUBE,
                "a dissipation of 20 s/m, assumed, leaves too little rebound; 3.9 s/m fits",
                kind="measured")),
)
# fmt: on
