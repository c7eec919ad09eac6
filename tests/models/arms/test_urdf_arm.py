"""An arm out of a URDF: what is read of it, what is no arm, and postures that are searched for."""

import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from scipy.spatial.transform import Rotation

from chamfer.models.arms.serial_arm import SerialArm, searched_posture
from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.arms.wam import WAM
from chamfer.models.validation import ParameterError

Array = np.ndarray

FILE = Path(__file__).with_name("six_joints.urdf")
TEXT = FILE.read_text(encoding="utf-8")
ARM = chosen_arm(str(FILE), None)
# The file once more: what is above each joint, m, and its axis.
STEPS = [
    ((0, 0, 0.02 + 0.12), "z"),
    ((0, 0.11, 0), "y"),
    ((0, -0.1, 0.45), "y"),
    ((0, 0.09, 0.4), "y"),
    ((0, 0, 0.05 + 0.05), "z"),
]
angles = st.lists(st.floats(-2.5, 2.5), min_size=6, max_size=6).map(np.array)
Write = Callable[..., str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the file with a text in it replaced, and returns its path."""

    def written(old: str = "", new: str = "", *, count: int = 1) -> str:
        assert old in TEXT
        path = tmp_path / "arm.urdf"
        path.write_text(TEXT.replace(old, new, count), encoding="utf-8")
        return str(path)

    return written


def flange(q: Array) -> tuple[Rotation, Array]:
    R, p = Rotation.identity(), np.zeros(3)
    for (offset, axis), angle in zip(STEPS, q[:5], strict=True):
        p = p + R.apply(offset)
        R = R * Rotation.from_euler(axis, angle)
    p = p + R.apply((0, 0.08, 0))
    return R * Rotation.from_euler("x", -np.pi / 2) * Rotation.from_euler("z", q[5]), p


@settings(max_examples=20)
@given(q=angles)
def test_flange_is_where_the_file_puts_it(q: Array) -> None:
    R, p = flange(q)
    found = ARM.kinematics(q)
    np.testing.assert_allclose(found.R, R.as_matrix(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.p, p, rtol=0, atol=1e-12)
    for k, step in enumerate(1e-6 * np.eye(6)):
        (ahead, p_ahead), (back, p_back) = flange(q + step), flange(q - step)
        rate = [*(ahead * back.inv()).as_rotvec(), *(p_ahead - p_back)]
        np.testing.assert_allclose(found.J[:, k], np.array(rate) / 2e-6, rtol=0, atol=1e-8)


def test_what_the_file_says_of_the_joints() -> None:
    assert ARM.name == "six_joints"
    assert ARM.joint_names == ("turn", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    assert ARM.lower_limits == (-math.pi, -2.6, -2.7, -3.1, -3.1, -3.1)
    assert ARM.upper_limits == (math.pi, 2.6, 2.7, 3.1, 3.1, 3.1)
    assert ARM.torque_limits == (120, 130, 110, 30, 30, 30)
    assert ARM.dry_friction == (0.2, 0, 0.15, 0, 0, 0)
    assert ARM.rotor_inertia == pytest.approx((0, 0.4, 0, 0, 0, 0))  # 100^2 times the motor's
    assert ARM.posture is None
    assert ARM.base_height == 0


def test_nothing_collides_and_what_else_moves_is_weight() -> None:
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModelsFromString(ARM.urdf, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(ARM.base))
    plant.Finalize()
    assert plant.num_positions() == plant.num_actuators() == 6
    bodies = [plant.get_body(BodyIndex(i)) for i in range(1, plant.num_bodies())]
    assert sum(one.default_mass() for one in bodies) == pytest.approx(19.75)
    assert not {"world", "tool", "payload"} & {one.name() for one in bodies}
    assert "collision" not in ARM.urdf
    assert "mesh" not in ARM.urdf
    assert ARM.urdf.count("<visual>") == 1
    for i, name in enumerate(ARM.joint_names):
        assert plant.GetJointActuatorByName(f"{name}_motor").input_start() == i
    assert plant.GetJointByName("turn").default_damping() == 0.1


def test_meshes_that_drake_draws_stay(write: Write, tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/base.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for name in (f"package://{tmp_path.name}/meshes/base.obj", "meshes/base.obj"):
        arm = chosen_arm(write("package://nowhere/base.dae", name), None)
        assert str(tmp_path / "meshes/base.obj") in arm.urdf


def test_more_joints(write: Write) -> None:
    """A joint that is fixed in the file, made free."""
    arm = chosen_arm(write('name="column" type="fixed"', 'name="column" type="revolute"'), None)
    assert arm.joint_names[:2] == ("column", "turn")
    assert arm.num_joints == 7


def test_link_that_carries_the_tool(write: Write) -> None:
    assert chosen_arm(str(FILE), "tool") == ARM
    assert ARM.flange == "tool_of_file"
    two = write(
        "  <transmission name",
        '<link name="eye"/><joint name="on" type="fixed">'
        '<parent link="hand_3"/><child link="eye"/></joint><transmission name',
    )
    assert chosen_arm(two, None).flange == "tool_of_file"  # there are five joints above the eye
    three = write(
        "  <transmission name",
        '<link name="eye"/><joint name="on" type="fixed">'
        '<parent link="tool"/><child link="eye"/></joint><transmission name',
    )
    assert chosen_arm(three, None).flange == "eye"
    for carried in ("1.1", "0.2"):  # by what is fixed to it, and by the tool
        assert chosen_arm(write(f'<mass value="{carried}"/>', '<mass value="0"/>'), None)


def test_the_end_of_several_arms_has_to_be_chosen(write: Write) -> None:
    ends = "".join(
        f'<link name="{name}"/><joint name="{name}_on" type="fixed"><parent link="tool"/>'
        f'<child link="{name}"/></joint>'
        for name in ("eye", "hand")
    )
    path = write("  <transmission name", f"{ends}<transmission name")
    message = "^tool_frame is None, allowed: one of the model's links eye, hand$"
    with pytest.raises(ParameterError, match=message):
        chosen_arm(path, None)
    assert chosen_arm(path, "hand").flange == "hand"


@pytest.mark.parametrize(
    ("old", "new", "allowed"),
    [
        ("<robot", "<robots", r"mismatched tag"),
        ('name="elbow" type="revolute"', 'name="elbow" type="prismatic"', "'elbow' is prismatic"),
        (
            '<axis xyz="0 1 0"/>\n    <limit lower="-2.7"',
            '<mimic joint="lift"/><limit lower="-2.7"',
            "'elbow' is mimic",
        ),
        (' effort="110"', "", "'elbow' has a limit with effort"),
        ('effort="110"', 'effort="0"', "'elbow' has an effort limit > 0, not 0"),
        ('lower="-2.7"', 'lower="3"', "'elbow' has a range, not 3 to 2.7"),
        ('lower="-2.7"', 'lower="nan"', "lower of joint 'elbow' is a finite number, not nan"),
        ('friction="0.15"', 'friction="-1"', "'elbow' has a friction >= 0, not -1"),
        ('<parent link="hand_3"/>', '<parent link="hand_9"/>', "parent of joint 'wrist_3'"),
        ('<parent link="post"/>', '<parent link="tool"/>', "isn't above itself"),
        ('<child link="finger"/>', '<child link="tool"/>', "a single joint is above link 'tool'"),
        ('name="tool"', "", "every link has a name"),
        ('<mass value="1.1"/>', '<mass value="-1.1"/>', "'hand_1' has mass and inertia as"),
        ('ixx="0.03"', 'ixx="0.3"', "'forearm' has mass and inertia as"),
        ('<mass value="6.0"/>', '<mass value="0"/>', "a link with mass and inertia, unlike lift"),
        ('<origin xyz="0 0 0.17"/>', '<origin xyz="0 0 up"/>', "that Drake can read"),
        ('name="foot" type="fixed"', 'name="foot" type="planar"', "'foot' is planar"),
    ],
)  # fmt: skip
def test_files_of_no_arm(write: Write, old: str, new: str, allowed: str) -> None:
    with pytest.raises(ParameterError) as caught:
        chosen_arm(write(old, new), "tool")
    message = str(caught.value)
    assert message.startswith("model is '")
    assert allowed in message
    assert "\n" not in message


def test_no_file_and_no_chain(tmp_path: Path, write: Write) -> None:
    with pytest.raises(ParameterError, match=r"ur5e, scara, or a URDF file \(No such file"):
        chosen_arm(str(tmp_path / "none.urdf"), None)
    with pytest.raises(ParameterError, match=r"ur5e, scara, or a URDF file \(Is a directory"):
        chosen_arm(str(tmp_path), None)
    few = write('name="elbow" type="revolute"', 'name="elbow" type="fixed"')
    with pytest.raises(ParameterError, match="an arm with 6 or more revolute joints in a row"):
        chosen_arm(few, None)
    with pytest.raises(ParameterError, match="revolute joints on the way to 'tool', not 5"):
        chosen_arm(few, "tool")
    with pytest.raises(ParameterError, match=r"tool_frame is 'hand', allowed: one of .*post"):
        chosen_arm(str(FILE), "hand")


def test_a_file_that_has_changed_is_read_again(write: Write) -> None:
    path = write()
    assert chosen_arm(path, None) is chosen_arm(path, None)
    write('effort="110"', 'effort="111"')
    os.utime(path, (1, 1))
    assert chosen_arm(path, None).torque_limits[2] == 111


def test_the_wam_is_built_in() -> None:
    assert chosen_arm("wam", None) is WAM
    message = re.escape("tool_frame is 'flange', allowed: null: wam has its flange")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        chosen_arm("wam", "flange")


def test_an_arm_without_shapes_is_drawn_as_sticks(write: Write) -> None:
    shape = '<visual><geometry><cylinder radius="0.06" length="0.14"/></geometry>'
    arm = chosen_arm(write(f'{shape}<material name="grey"/></visual>', ""), None)
    assert arm.urdf.count("<cylinder") == 7  # all but the foot and the column are long enough
    root = ElementTree.fromstring(arm.urdf)
    origin = root.find("link[@name='upper_arm']/visual/origin")
    assert origin is not None
    middle, turn = (np.array(origin.get(name, "").split(), float) for name in ("xyz", "rpy"))
    np.testing.assert_allclose(middle, [0, -0.05, 0.225])
    along = Rotation.from_euler("xyz", turn).apply([0, 0, 1])
    np.testing.assert_allclose(along, middle / np.linalg.norm(middle), atol=1e-12)


SIX_JOINTS = chosen_arm(str(Path(__file__).with_name("six_joints.urdf")), None)
AHEAD = Rotation.from_matrix([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # z ahead
UP = np.array([0.0, 0.0, 1.0])
PLACE = np.array([0.55, 0.1, 0.2])


@pytest.mark.parametrize("arm", [SIX_JOINTS, WAM])
def test_the_flange_is_where_it_is_asked_to_be(arm: SerialArm) -> None:
    q = searched_posture(arm, AHEAD.as_matrix(), PLACE, UP)
    found = arm.kinematics(q)
    np.testing.assert_allclose(found.R, AHEAD.as_matrix(), rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.p, PLACE, rtol=0, atol=1e-10)
    assert arm.within_limits(q)
    assert np.linalg.svd(found.J, compute_uv=False)[-1] > 0.05
    np.testing.assert_array_equal(q, searched_posture(arm, AHEAD.as_matrix(), PLACE, UP))


def test_the_elbow_is_up_against_gravity() -> None:
    def height(up: np.ndarray) -> float:
        """How high the elbow is, of the base's z."""
        _, lift, *_ = searched_posture(SIX_JOINTS, AHEAD.as_matrix(), PLACE, up)
        return float(np.cos(lift))

    assert height(UP) > 0.2
    assert height(-UP) < height(UP) - 0.3


@pytest.mark.parametrize("place", [(2.0, 0.0, 0.2), (0.0, 0.0, 0.2)])
def test_what_is_out_of_reach(place: tuple[float, float, float]) -> None:
    message = rf"^flange position is \({place[0]}, .*\), allowed: within reach of six_joints, so"
    with pytest.raises(ParameterError, match=message):
        searched_posture(SIX_JOINTS, AHEAD.as_matrix(), np.array(place), UP)
