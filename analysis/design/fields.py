"""The fields of a cell that a designer may change, and how each is changed."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

from chamfer.analysis.design.design_scenario import DesignScenario
from chamfer.models.validation import ParameterError

Change = Callable[[DesignScenario, float], DesignScenario]


class DesignField(NamedTuple):
    """A field, and the range in which it is looked for a change."""

    path: str
    unit: str
    meaning: str
    low: float  # least factor of its value that is tried
    high: float  # largest factor
    get: Callable[[DesignScenario], float]  # of a resolved scenario
    set: Change  # of one whose open fields are open still


def _stiffness() -> tuple[Callable[[DesignScenario], float], Change]:
    """Return the arms' stiffness along the third axis, and what scales all three by it."""

    def change(scenario: DesignScenario, value: float) -> DesignScenario:
        x, y, z = scenario.impedance.stiffness
        scaled = (x * value / z, y * value / z, value)
        return replace(scenario, impedance=replace(scenario.impedance, stiffness=scaled))

    return lambda scenario: scenario.impedance.stiffness[2], change


def _rotational_stiffness() -> tuple[Callable[[DesignScenario], float], Change]:
    """Return the arms' stiffness about the third axis, and what scales all three by it."""

    def change(scenario: DesignScenario, value: float) -> DesignScenario:
        x, y, z = scenario.impedance.rotational_stiffness
        scaled = (x * value / z, y * value / z, value)
        return replace(
            scenario, impedance=replace(scenario.impedance, rotational_stiffness=scaled)
        )

    return lambda scenario: scenario.impedance.rotational_stiffness[2], change


def _nested(*names: str) -> tuple[Callable[[DesignScenario], float], Change]:
    """Return a field some levels below the scenario, and what changes it."""

    def get(scenario: DesignScenario) -> float:
        value: object = scenario
        for name in names:
            value = getattr(value, name)
        assert isinstance(value, (int, float))
        return float(value)

    def change(scenario: DesignScenario, value: float) -> DesignScenario:
        owners: list[object] = [scenario]
        for name in names[:-1]:
            owners.append(getattr(owners[-1], name))
        new: object = value
        for owner, name in zip(reversed(owners), reversed(names), strict=True):
            new = replace(owner, **{name: new})  # type: ignore[type-var]
        assert isinstance(new, DesignScenario)
        return new

    return get, change


def _clearance() -> tuple[Callable[[DesignScenario], float], Change]:
    """Return the clearance, and what gives the peg the radius that it asks for."""

    def change(scenario: DesignScenario, value: float) -> DesignScenario:
        radius = scenario.parts.hole_radius - value
        if not radius > 0:
            raise ParameterError("parts.peg_radius", radius, "> 0")
        return replace(scenario, parts=replace(scenario.parts, peg_radius=radius))

    return lambda scenario: scenario.parts.clearance, change


def _centre() -> tuple[Callable[[DesignScenario], float], Change]:
    def change(scenario: DesignScenario, value: float) -> DesignScenario:
        return replace(scenario, support=replace(scenario.support, centre_distance=value))

    return lambda scenario: scenario.wedging_support.centre_distance, change


def _joint_friction() -> tuple[Callable[[DesignScenario], float], Change]:
    """Return the largest dry friction of the peg's arm, and what scales that of all joints."""

    def get(scenario: DesignScenario) -> float:
        return max(scenario.peg.arm.dry_friction)

    def change(scenario: DesignScenario, value: float) -> DesignScenario:
        factor = value / get(scenario)
        arms = {
            name: replace(
                getattr(scenario, name),
                joint_friction=tuple(
                    factor * one for one in getattr(scenario, name).arm.dry_friction
                ),
            )
            for name in scenario.arms
        }
        return replace(scenario, **arms)

    return get, change


_FINE: Final = (0.1, 10.0)  # factors of a value between which a change is looked for

FIELDS: Final[tuple[DesignField, ...]] = (
    DesignField("impedance.stiffness", "N/m", "stiffness of the arms", *_FINE, *_stiffness()),
    DesignField(
        "impedance.rotational_stiffness",
        "N m/rad",
        "rotational stiffness of the arms",
        *_FINE,
        *_rotational_stiffness(),
    ),
    DesignField(
        "support.centre_distance", "m", "centre of compliance above the tip", *_FINE, *_centre()
    ),
    *(
        DesignField(
            f"compensator.{kind}.{name}",
            unit,
            f"{says} of the {kind} compensation",
            *_FINE,
            *_nested("compensator", kind, name),
        )
        for kind, units in (("lateral", ("pixels", "m")), ("rotational", ("rad", "rad")))
        for (name, says), unit in zip(
            (("dead_zone", "dead zone"), ("increment", "increment")), units, strict=True
        )
    ),
    DesignField(
        "cameras.pixel_size", "m", "size of a pixel", 0.2, 5.0, *_nested("cameras", "pixel_size")
    ),
    DesignField(
        "cameras.distance",
        "m",
        "distance, and with it the focal length",
        0.2,
        5.0,
        *_nested("cameras", "distance"),
    ),
    DesignField(
        "cameras.frames.noise",
        "grey levels",
        "noise of the images",
        *_FINE,
        *_nested("cameras", "frames", "noise"),
    ),
    DesignField(
        "parts.chamfer_width",
        "m",
        "width of the chamfers",
        *_FINE,
        *_nested("parts", "chamfer_width"),
    ),
    DesignField("parts.clearance", "m", "clearance, by the peg's radius", *_FINE, *_clearance()),
    DesignField(
        "parts.friction", "", "friction of the parts", *_FINE, *_nested("parts", "friction")
    ),
    DesignField("insert.speed", "m/s", "speed of the feed", *_FINE, *_nested("insert", "speed")),
    DesignField("insert.push", "N", "hardest push", *_FINE, *_nested("insert", "push")),
    DesignField(
        "insert.force_limit",
        "N",
        "force that stops all",
        *_FINE,
        *_nested("insert", "force_limit"),
    ),
    DesignField(
        "spread.lateral", "m", "lateral error of the starts", *_FINE, *_nested("spread", "lateral")
    ),
    DesignField(
        "spread.rotational",
        "rad",
        "tilt of the starts",
        *_FINE,
        *_nested("spread", "rotational"),
    ),
    DesignField(
        "peg.payload_error",
        "kg",
        "unknown payload of the peg's arm",
        *_FINE,
        *_nested("peg", "payload_error"),
    ),
    DesignField(
        "peg.joint_friction", "N m", "dry friction of the joints", *_FINE, *_joint_friction()
    ),
)
