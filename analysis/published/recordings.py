"""Results on recordings of real robots, with limits for the simulator and its observers."""

from functools import partial
from typing import Final

from chamfer.analysis.published.rows import Row, at_least, at_most, between, near, of
from chamfer.analysis.report.checks import Published

TITLE: Final = "Recordings of real robots"

_SETTINGS: Final = "the observer's settings come from half of table_a"


# fmt: off
_SLIDES: Final = "slides of a KUKA iiwa over a table"

_CUBE: Final = "tosses of a cube, DAIRLab/dair_pll, contactnets_cube"
_LAGGED: Final = "friction is bounded by the impulse that is expected before the impact"


def _toss(setting: str, note: str = "") -> tuple[Row, ...]:
    """Return the limits of a setting on the tosses that were not used to fit it."""
    return tuple(partial(row, kind="measured") for row in (
        between(f"{setting}.travel", 90.0, 110.0, "%", _CUBE, note),
        at_most(f"{setting}.position", 25.0, "%", _CUBE, note),
    ))


PUBLISHED: Final[tuple[Published, ...]] = (
    *of("measured-slide", *(partial(row, kind="measured") for row in (
        at_least("adaptive.coverage", 95.0, "%", _SLIDES,
                 f"share of the errors within 3 standard deviations; {_SETTINGS}"),
        at_most("rms_ratio", 1.5, "", _SLIDES,
                f"rms error of the adaptive observer over the thesis'; {_SETTINGS}"),
        at_most("adaptive.pulls", 0.0, "%", _SLIDES,
                "share of the samples with a force into the estimated surface, which can't pull"),
        at_most("adaptive.unfit", 0.0, "%", _SLIDES, _SETTINGS),
        *(near(f"{name}.touch", 2.0, 0.05, "s", _SLIDES, "recordings are cut 2 s before contact")
          for name in ("table_a", "table_b", "table_press")),
        at_most("free.false_alarms", 0.0, "", "the same arm in the air",
                "contacts detected in free motion")))),
    *of("measured-toss",
        *_toss("drake", _LAGGED), *_toss("insertion", _LAGGED), *_toss("connectors"),
        *_toss("similar"), *_toss("similar.fitted"),
        at_least("similar.same_face", 70.0, "%", _CUBE, kind="measured"),
        between("connectors.rebound", -5.0, 5.0, "%", _CUBE,
                "the assumed dissipation of 20 s/m gives too little rebound; 3.9 s/m fits",
                kind="measured")),
)
# fmt: on
