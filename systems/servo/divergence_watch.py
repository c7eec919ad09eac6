"""The watch that stops a compensation which makes its error grow, as a block."""

from chamfer.systems.law_block import LawBlock
from chamfer.systems.servo.divergence_law import DivergenceLaw, DivergenceParams


class DivergenceWatch(LawBlock[DivergenceLaw]):
    """Stops a compensation permanently once the measured error has grown beyond its start.

    .. pydrake_system::

        name: DivergenceWatch
        input_ports:
        - error
        - valid
        - blind (optional)
        output_ports:
        - valid
        - diverged
        - stop

    The inputs ``error``, shape (size,), and ``valid``, shape (1,), are those that a controller
    acts on. The start is the first valid error. The block counts the valid frames in which the
    size of some axes together is more than ``factor`` times its start. At ``frames`` of them it
    reports divergence:

    - ``diverged``, shape (1,), turns to 1 and stays so.
    - ``valid``, shape (1,), is 0 from then on, so that a controller holds its output.
    - ``stop``, shape (1,), is 1 once it has diverged, and while ``blind`` is 1.

    A valid frame without such an axis takes a quarter of a frame back. So an error that swings to
    and fro is reported, and an occasional wrong frame is not. While ``blind`` is 1 a single frame
    is enough, and one before it that nothing took back. A part that gets lost while its error
    grows is driven out of view, and must not be driven further when it is visible again.

    A camera that is turned around, or gains that are too high, make the loop diverge. The block
    uses measured errors alone: it also reports errors that grow while the parts come closer.

    Discrete state: the sizes at the start, NaN before; the frames; ``diverged``.
    """

    def __init__(self, params: DivergenceParams) -> None:
        super().__init__(DivergenceLaw(params))
