"""A user's own arm, from a URDF.

The arm is the chain from the file's first link to the link that carries the tool. Whatever else
can move, such as the fingers of a gripper, is held where its joint is at zero, and is weight. Of
the shapes nothing collides, and only what Drake draws is drawn: boxes, spheres, cylinders,
capsules, and meshes in ``.obj``, ``.gltf`` or ``.vtk`` files whose place is plain; where nothing
is left of the arm, a stick from joint to joint.
"""

import math
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from chamfer.models.arms.scara import scara
from chamfer.models.arms.serial_arm import PlantKinematics, SerialArm
from chamfer.models.arms.wam import WAM
from chamfer.models.validation import ParameterError

LEAST_JOINTS: Final = 6

_ROUNDED: Final = 1e-3  # relative, of what files say of inertias
_LARGEST_FILE: Final = 10_000_000  # bytes
_DRAKE: Final = "{http://drake.mit.edu}"
_STICK: Final = 0.03  # m, radius of what is drawn of an arm without shapes; assumed
_DRAWN: Final = (".obj", ".gltf", ".vtk")
_RIGID: Final = ("revolute", "continuous", "fixed")  # below which an arm may go on
_KEPT: Final = ("link", "joint", "material")
_KEPT_OF_JOINT: Final = ("parent", "child", "origin", "axis", "limit", "dynamics")
_FIXED_HAS_NO: Final = ("axis", "limit", "dynamics")
_UR5E: Final = Path(__file__).with_name("ur5e.urdf")
# What the cell itself adds to an arm, and what Drake calls the world.
_TAKEN: Final = ("tool", "payload", "world")
_MODELS: Final = "wam, ur5e, scara, or a URDF file"


class _Chain(NamedTuple):
    """The chain from the file's first link to the flange."""

    links: list[str]
    joints: list[Element]  # in between
    moving: list[Element]  # of them, those that aren't fixed


def read_arm(path: str, tool_frame: str | None) -> SerialArm:
    """Return the arm of a URDF file, from its base to the link that carries the tool.

    ``tool_frame`` is that link; None: the end of the only chain of the file that is an arm.

    Raises:
        ParameterError: ``model`` or ``tool_frame``: the file can't be read, is no arm with six or
            more revolute joints, or says of a joint neither its range nor its largest torque.
    """
    try:
        stat = Path(path).stat()
        return _read(path, tool_frame, stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        raise ParameterError("model", path, f"{_MODELS} ({error.strerror})") from error


@lru_cache(maxsize=16)
def _read(path: str, tool_frame: str | None, changed: int, size: int) -> SerialArm:
    if size > _LARGEST_FILE:
        raise ParameterError("model", path, f"a URDF file of at most {_LARGEST_FILE} bytes")
    try:
        root = ElementTree.fromstring(Path(path).read_bytes())
    except ElementTree.ParseError as error:
        raise ParameterError("model", path, f"{_MODELS} ({error})") from error
    if root.tag != "robot" or root.find("link") is None:
        raise ParameterError("model", path, f"{_MODELS}, with a robot and its links")
    try:
        return _arm(root, Path(path), tool_frame)
    except UnfitError as error:
        raise ParameterError("model", path, f"a URDF file {error}") from error


class UnfitError(ValueError):
    """Requirement on a URDF file; the message continues after "a URDF file"."""


def _arm(root: Element, path: Path, tool_frame: str | None) -> SerialArm:
    above = _joints_above(root)
    names = [_name(link) for link in root.findall("link")]
    chain = _chain(above, names, tool_frame)
    rotors = _rotor_inertia(root)
    _require_inertia(above, chain, [one for one in root.findall("link") if _is_body(one)])
    joint_names = [_name(joint) for joint in chain.moving]
    lower, upper, torque, friction = zip(*map(_limits, chain.moving), strict=True)
    _make_plain(root, chain, path)
    for name in joint_names:
        root.append(_motor(name))
    text = ElementTree.tostring(root, encoding="unicode")
    base, flange = _free(chain.links[0]), _free(chain.links[-1])
    try:
        kinematics = PlantKinematics(text, base, flange)
    except (RuntimeError, ValueError, SystemExit) as error:
        told = " ".join(str(error).split())
        raise UnfitError(f"that Drake can read ({told})") from error
    return SerialArm(
        name=path.stem,
        urdf=text,
        base=base,
        flange=flange,
        joint_names=tuple(joint_names),
        lower_limits=lower,
        upper_limits=upper,
        torque_limits=torque,
        rotor_inertia=tuple(rotors.get(name, 0.0) for name in joint_names),
        dry_friction=friction,
        kinematics=kinematics,
    )


def _name(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise UnfitError(f"in which every {element.tag} has a name")
    return name


def _joints_above(root: Element) -> dict[str, Element]:
    """Return the joint above each link but the first."""
    links = {_name(link) for link in root.findall("link")}
    above: dict[str, Element] = {}
    for joint in root.findall("joint"):
        for role in ("parent", "child"):
            end = joint.find(role)
            if end is None or end.get("link") not in links:
                raise UnfitError(f"in which the {role} of joint {_name(joint)!r} is a link")
        child = _end(joint, "child")
        if child in above:
            raise UnfitError(f"in which a single joint is above link {child!r}")
        above[child] = joint
    if len(links - above.keys()) != 1:
        raise UnfitError("in which all links but the first one are below another one")
    return above


def _end(joint: Element, role: str) -> str:
    end = joint.find(role)
    assert end is not None
    return end.get("link", "")


def _way(above: dict[str, Element], link: str) -> tuple[list[str], list[Element]]:
    """Return the links from the first one to one, and the joints between them."""
    links: list[str] = [link]
    joints: list[Element] = []
    while (joint := above.get(links[0])) is not None:
        links.insert(0, _end(joint, "parent"))
        joints.insert(0, joint)
        if len(joints) > len(above):
            raise UnfitError(f"in which link {link!r} isn't above itself")
    return links, joints


def _revolute(joint: Element) -> bool:
    return joint.get("type") in ("revolute", "continuous") and joint.find("mimic") is None


def _chain(above: dict[str, Element], names: list[str], tool_frame: str | None) -> _Chain:
    if tool_frame is None:
        going_on = (joint for joint in above.values() if joint.get("type") in _RIGID)
        parents = {_end(joint, "parent") for joint in going_on}
        ends = [one for one in names if one not in parents and _is_arm(above, one)]
        if not ends:
            raise UnfitError(f"of an arm with {LEAST_JOINTS} or more revolute joints in a row")
        if len(ends) > 1:
            raise ParameterError("tool_frame", None, f"one of the model's links {', '.join(ends)}")
        (tool_frame,) = ends
    elif tool_frame not in names:
        told = ", ".join(names)
        raise ParameterError("tool_frame", tool_frame, f"one of the model's links {told}")
    links, joints = _way(above, tool_frame)
    moving = [joint for joint in joints if joint.get("type") != "fixed"]
    on_the_way = f"on the way to {tool_frame!r}"
    for joint in moving:
        if not _revolute(joint):
            kind = "mimic" if joint.get("type") in _RIGID else joint.get("type")
            raise UnfitError(
                f"with revolute joints alone {on_the_way}; {_name(joint)!r} is {kind}"
            )
    if len(moving) < LEAST_JOINTS:
        least = f"{LEAST_JOINTS} or more revolute joints"
        raise UnfitError(f"with {least} {on_the_way}, not {len(moving)}")
    return _Chain(links, joints, moving)


def _is_arm(above: dict[str, Element], link: str) -> bool:
    _, joints = _way(above, link)
    moving = [joint for joint in joints if joint.get("type") != "fixed"]
    return len(moving) >= LEAST_JOINTS and all(map(_revolute, moving))


def _limits(joint: Element) -> tuple[float, float, float, float]:
    """Return range, rad, largest torque and dry friction, N m, of a joint."""
    limit = joint.find("limit")
    endless = joint.get("type") == "continuous"
    lower = -math.pi if endless else _number(joint, limit, "lower")
    upper = math.pi if endless else _number(joint, limit, "upper")
    if not lower < upper:
        raise UnfitError(f"in which {_name(joint)!r} has a range, not {lower:g} to {upper:g}")
    torque = _number(joint, limit, "effort")
    if not torque > 0:
        raise UnfitError(f"in which {_name(joint)!r} has an effort limit > 0, not {torque:g}")
    dynamics = joint.find("dynamics")
    if dynamics is None or dynamics.get("friction") is None:
        return lower, upper, torque, 0.0
    friction = _number(joint, dynamics, "friction")
    if friction < 0:
        raise UnfitError(f"in which joint {_name(joint)!r} has a friction >= 0, not {friction:g}")
    return lower, upper, torque, friction


def _number(joint: Element, element: Element | None, name: str) -> float:
    text = None if element is None else element.get(name)
    kind = "limit" if element is None else element.tag
    if text is None:
        raise UnfitError(f"in which joint {_name(joint)!r} has a {kind} with {name}")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        told = f"in which {name} of joint {_name(joint)!r} is a finite number, not {text}"
        raise UnfitError(told)
    return value


def _require_inertia(above: dict[str, Element], chain: _Chain, bodies: list[Element]) -> None:
    """Refuse an arm with a joint that moves no mass; the last one has the tool."""
    moved = set()
    for link in bodies:
        joint = above.get(_name(link))
        while joint is not None and joint not in chain.moving:
            joint = above.get(_end(joint, "parent"))
        moved.add(joint)
    if idle := [_name(joint) for joint in chain.moving[:-1] if joint not in moved]:
        told = f"in which every joint moves a link with mass and inertia, unlike {', '.join(idle)}"
        raise UnfitError(told)


def _is_body(link: Element) -> bool:
    """Return whether a link has mass and inertia.

    An inertia that no body has is refused: Drake would put another one in its place.
    """
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    inertia = None if inertial is None else inertial.find("inertia")
    if mass is None or inertia is None:
        return False  # no weight, or what Drake refuses
    try:
        weight = float(mass.get("value", "nan"))
        xx, yy, zz, xy, xz, yz = (
            float(inertia.get(f"i{axes}", 0.0)) for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
    except ValueError:
        weight = xx = yy = zz = xy = xz = yz = math.nan
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if weight >= 0 and np.isfinite(matrix).all() and math.isfinite(weight):
        least, middle, most = np.linalg.eigvalsh(matrix)
        if least >= 0 and least + middle >= most * (1 - _ROUNDED):
            return bool(weight > 0 and most > 0)
    raise UnfitError(f"in which link {_name(link)!r} has mass and inertia as bodies have")


def _rotor_inertia(root: Element) -> dict[str, float]:
    """Return the inertia of each motor that the file has, kg m^2, as seen at its joint."""
    found = {}
    for transmission in root.findall("transmission"):
        joint, actuator = transmission.find("joint"), transmission.find("actuator")
        if joint is None or actuator is None:
            continue
        rotor = actuator.find(f"{_DRAKE}rotor_inertia")
        if rotor is None:
            continue
        gear = actuator.find(f"{_DRAKE}gear_ratio")
        ratio = 1.0 if gear is None else _number(joint, gear, "value")
        inertia = _number(joint, rotor, "value") * ratio**2
        if inertia < 0:
            raise UnfitError(f"in which joint {_name(joint)!r} has a rotor's inertia >= 0")
        found[_name(joint)] = inertia
    return found


def _motor(joint: str) -> Element:
    motor = Element("transmission")
    ElementTree.SubElement(motor, "type").text = "SimpleTransmission"
    ElementTree.SubElement(motor, "joint", name=joint)
    ElementTree.SubElement(motor, "actuator", name=f"{joint}_motor")
    return motor


def _free(link: str) -> str:
    """Return a link's name here, which differs from the names that the cell adds."""
    return f"{link}_of_file" if link in _TAKEN else link


def _make_plain(root: Element, chain: _Chain, path: Path) -> None:
    """Leave links, joints and drawn shapes, and only the arm's joints free."""
    for element in list(root):
        if element.tag not in _KEPT:
            root.remove(element)
    for link in root.findall("link"):
        link.set("name", _free(_name(link)))
        for collision in link.findall("collision"):
            link.remove(collision)
        for visual in link.findall("visual"):
            if not _is_drawn(visual, path):
                link.remove(visual)
    if root.find("link/visual") is None:
        _draw_sticks(root, chain)
    for joint in root.findall("joint"):
        for role in ("parent", "child"):
            end = joint.find(role)
            assert end is not None
            end.set("link", _free(end.get("link", "")))
        held = joint not in chain.moving
        if held:
            joint.set("type", "fixed")
        for element in list(joint):
            if element.tag not in _KEPT_OF_JOINT or (held and element.tag in _FIXED_HAS_NO):
                joint.remove(element)
        for dynamics in joint.findall("dynamics"):
            dynamics.attrib = {k: v for k, v in dynamics.attrib.items() if k == "damping"}


def _draw_sticks(root: Element, chain: _Chain) -> None:
    links = {_name(link): link for link in root.findall("link")}
    for joint in chain.joints:
        origin = joint.find("origin")
        text = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
        try:
            x, y, z = map(float, text.split())
        except ValueError:
            continue  # which Drake refuses
        length = math.hypot(x, y, z)
        if length < _STICK:
            continue
        visual = ElementTree.SubElement(links[_free(_end(joint, "parent"))], "visual")
        turn = f"0 {math.atan2(math.hypot(x, y), z)} {math.atan2(y, x)}"
        ElementTree.SubElement(visual, "origin", xyz=f"{x / 2} {y / 2} {z / 2}", rpy=turn)
        geometry = ElementTree.SubElement(visual, "geometry")
        ElementTree.SubElement(geometry, "cylinder", radius=str(_STICK), length=str(length))


def _is_drawn(visual: Element, path: Path) -> bool:
    """Return whether Drake draws a shape; the path of its mesh is made absolute."""
    geometry = visual.find("geometry")
    mesh = None if geometry is None else geometry.find("mesh")
    if mesh is None:
        return geometry is not None
    name = mesh.get("filename", "")
    if not name.lower().endswith(_DRAWN):
        return False
    if name.startswith("package://"):
        inside = Path(*Path(name.removeprefix("package://")).parts)
        places = [folder / inside for folder in path.resolve().parents]
    else:
        places = [path.resolve().parent / name.removeprefix("file://")]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        return False
    mesh.set("filename", str(found))
    return True


# Arms that are not out of a user's file, made when they are wanted.
BUILT_IN: Final = {
    WAM.name: lambda: WAM,
    "ur5e": lambda: read_arm(str(_UR5E), "flange"),
    "scara": scara,
}


@lru_cache(maxsize=16)
def _built_in(model: str) -> SerialArm:
    return BUILT_IN[model]()


def chosen_arm(model: str, tool_frame: str | None) -> SerialArm:
    """Return the arm of a model: one of ``BUILT_IN``, or of the path of a URDF file."""
    if model not in BUILT_IN:
        return read_arm(model, tool_frame)
    if tool_frame is not None:
        raise ParameterError("tool_frame", tool_frame, f"null: {model} has its flange")
    return _built_in(model)
