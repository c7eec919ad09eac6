"""Which arm a scenario names."""

from typing import Final

from chamfer.models.arms.serial_arm import SerialArm
from chamfer.models.arms.urdf_arm import read_arm
from chamfer.models.arms.wam import WAM
from chamfer.models.validation import ParameterError

BUILT_IN: Final = {WAM.name: WAM}


def chosen_arm(model: str, tool_frame: str | None) -> SerialArm:
    """Return the arm of a model.

    Args:
        model: ``wam``, or the path of a URDF file.
        tool_frame: The link of the file that carries the tool; None: derived.

    Raises:
        ParameterError: ``model`` or ``tool_frame``: as
        :func:`chamfer.models.arms.urdf_arm.read_arm`.
    """
    if model not in BUILT_IN:
        return read_arm(model, tool_frame)
    if tool_frame is not None:
        raise ParameterError("tool_frame", tool_frame, f"null: {model} has its flange")
    return BUILT_IN[model]
