"""What recordings of real robots show, and how close the simulator and its observers come."""

from typing import Final

from chamfer.analysis.report.checks import Published

TITLE: Final = "Recordings of real robots"

PUBLISHED: Final[tuple[Published, ...]] = ()
