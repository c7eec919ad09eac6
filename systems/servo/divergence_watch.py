"""The watch that stops a compensation which makes its error grow, as a block."""

from chamfer.systems.law_block import LawBlock
from chamfer.systems.servo.divergence_law import DivergenceLaw, DivergenceParams


class DivergenceWatch(LawBlock[DivergenceLaw]):
    """Stops a compensation for good once the measured error has grown beyond its start.

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

    ``error``, shape (size,), and ``valid``, shape (1,), are what a controller measures and acts
    on. The start is the first valid error. Once the size of some axes together has been more than
    ``factor`` times its start in ``frames`` valid frames, ``diverged``, shape (1,), turns to 1
    and stays so, and ``valid``, shape (1,), is 0 from then on, so that a controller holds what it
    has. A frame in which none has takes a quarter of one back, so that an error that swings to
    and fro is told, and a wrong frame now and then is not. While ``blind`` is 1 a single frame is
    enough, and one before it that nothing took back: what gets lost while its error grows is
    driven out of sight, and must not be driven on when it is seen again. ``stop``, shape (1,), is
    1 once it is told, and while ``blind`` is 1.

    A camera that is turned around, or gains that are too high, make the loop diverge. It is told
    by measured errors alone: where they grow though the parts come closer it is told too.

    Discrete state: the sizes at the start, NaN before; the frames; ``diverged``.
    """

    def __init__(self, params: DivergenceParams) -> None:
        super().__init__(DivergenceLaw(params))
