"""A SCARA arm for the work cell: the Adept One with the ranges and forces of its joints.

Its tool turns about the vertical alone: a hole's axis has to be vertical, and the arm takes what
is asked for of tilt as far as it can, which is not at all. The ranges of turns are of the order of
the maker's; largest torques are assumed.
"""

import math
from pathlib import Path
from typing import Final

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.serial_arm import PlantKinematics, SerialArm

# The flange is at the quill's end, its z axis out of the arm.
_FLANGE: Final = f"""
  <link name="flange"/>
  <joint name="flange_joint" type="fixed">
    <parent link="link_4"/>
    <child link="flange"/>
    <origin rpy="{math.pi} 0 0"/>
  </joint>
</robot>"""


def scara() -> SerialArm:
    """Return the arm."""
    urdf = Path(ADEPT_ONE.urdf).read_text(encoding="utf-8").replace("</robot>", _FLANGE)
    return SerialArm(
        name="scara",
        urdf=urdf,
        base="base",
        flange="flange",
        joint_names=ADEPT_ONE.joint_names,
        lower_limits=(-2.6, -2.5, 0.0, -4.7),  # rad, and m of the quill, downwards
        upper_limits=(2.6, 2.5, 0.3, 4.7),
        torque_limits=(100.0, 50.0, 200.0, 10.0),
        rotor_inertia=(0.3, 0.1, 0.0, 0.015),
        dry_friction=(0.0,) * 4,
        kinematics=PlantKinematics(urdf, "base", "flange"),
        posture=(-0.6, 1.2, 0.15, 0.0),
    )
