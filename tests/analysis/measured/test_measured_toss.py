"""Tosses of a cube: flights against theory, contacts against Coulomb's law, and the fit."""

import re
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.analysis.measured import measured_toss as tossed
from chamfer.analysis.measured.measured_toss import CONTACTS, MeasuredTossScenario, Throw, measure
from chamfer.analysis.scenario.experiment import quiet
from chamfer.diagrams.contact.cube_toss import fly, make_toss_diagram, rotations
from chamfer.models.recordings import recordings as cube
from chamfer.models.recordings.recordings import CUBE_GROUND, CUBE_RATE, CUBE_WIDTH, Toss, tosses
from chamfer.models.validation import ParameterError

G = 9.81  # m/s^2, Drake's
RECORDED = tosses()[7]
BOXES = CONTACTS["similar"]


def dropped(tilt: float) -> Toss:
    """Return 1 s of a cube that falls by 20 mm, turned about x, rad; nothing else is said."""
    height = CUBE_GROUND + CUBE_WIDTH * (abs(np.cos(tilt)) + abs(np.sin(tilt))) / 2
    turned = Rotation.from_rotvec([tilt, 0, 0]).as_quat(scalar_first=True)
    zeros = np.zeros((148, 3))
    return Toss(
        0, np.tile(turned, (148, 1)), zeros + np.array([0, 0, height + 0.02]), zeros, zeros
    )


def test_a_flight_is_drakes_parabola_and_turns_about_a_fixed_axis() -> None:
    high = RECORDED._replace(position=RECORDED.position + np.array([0, 0, 9.0]))
    flight = fly(make_toss_diagram(BOXES), high)
    t = np.round(np.arange(len(high.position)) / CUBE_RATE / 1e-3) * 1e-3  # of the nearest step
    fall = -G * t * (t + 1e-3) / 2  # velocities go before positions
    expected = high.position[0] + t[:, None] * high.velocity[0]
    expected[:, 2] += fall
    np.testing.assert_allclose(flight.position, expected, atol=1e-9)
    start = rotations(high.orientation[0])
    turns = Rotation.from_rotvec(t[:, None] * start.apply(high.angular_velocity[0])) * start
    off = (rotations(flight.orientation).inv() * turns).magnitude()
    assert off.max() < 1e-2
    assert flight.normal_impulse == 0


def test_angular_velocity_is_in_the_cubes_axes() -> None:
    """Taken as the board's, the first tenth of a second is off by many degrees."""
    toss = Toss(RECORDED.number, *(one[:10] for one in RECORDED[1:]))
    diagram = make_toss_diagram(BOXES)
    to_cube = rotations(toss.orientation).inv()
    wrong = toss._replace(angular_velocity=to_cube.apply(toss.angular_velocity))
    off = [
        np.degrees((rotations(fly(diagram, one).orientation) * to_cube).magnitude())[-1]
        for one in (toss, wrong)
    ]
    assert off[0] < 2 < 8 < off[1]


@pytest.mark.parametrize("approximation", ["lagged", "similar", "tamsi", "sap"])
def test_energy_is_lost_alone_and_the_cube_rests_on_the_board(approximation: str) -> None:
    contact = CONTACTS[approximation]._replace(step=1 / CUBE_RATE / 7)  # rows on steps
    flight = fly(make_toss_diagram(contact), RECORDED)
    turned, middle = rotations(flight.orientation), flight.position[1:] + flight.position[:-1]
    velocity = np.diff(flight.position, axis=0) * CUBE_RATE
    rate = (turned[:-1].inv() * turned[1:]).magnitude() * CUBE_RATE
    energy = cube.CUBE_MASS * (G * middle[:, 2] / 2 + (velocity**2).sum(1) / 2)
    energy += cube.CUBE_INERTIA * rate**2 / 2
    assert np.diff(energy).max() < 0.01 * energy[0]
    assert energy[-1] < 0.4 * energy[0]
    assert flight.position[-1, 2] == pytest.approx(CUBE_GROUND + CUBE_WIDTH / 2, abs=5e-4)


@pytest.mark.parametrize(("tilt", "rests"), [(0.5, 0.0), (1.1, np.pi / 2)])
def test_a_cube_falls_on_the_nearer_face(
    tilt: float, rests: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = dropped(tilt)
    flat = Rotation.from_rotvec([rests, 0, 0]).as_quat(scalar_first=True)
    other = Rotation.from_rotvec([np.pi / 2 - rests, 0, 0]).as_quat(scalar_first=True)
    ends = [np.vstack([start.orientation[:-1], end]) for end in (flat, other)]
    told = [start._replace(orientation=end) for end in ends]
    far = np.linspace(0, 1, 148)[:, None] * [0.1, 0, -0.1]  # for what is divided by
    told = [one._replace(position=one.position + far) for one in told]
    monkeypatch.setattr(tossed, "recorded", lambda: told)
    rows = [measure(Throw(BOXES._replace(shape="corners"), k)) for k in (0, 1)]
    assert [bool(row["same_face"]) for row in rows] == [True, False]
    assert [row["angle_rest"] for row in rows] == pytest.approx([0, 90], abs=1)


def test_lagged_alone_breaks_coulombs_law_where_a_cube_hits() -> None:
    """Its friction's impulse is beyond mu times the normal one; softer parts heal it."""
    odd = tossed.MEASURED_TOSS.half(1)[:3]
    friction = 0.18
    contacts = tossed.MEASURED_TOSS.contacts(friction)

    def of(name: str) -> tuple[float, float]:
        rows = [measure(Throw(contacts[name], k)) for k in odd]
        return np.mean([r["coulomb"] for r in rows]), np.mean([r["travel"] for r in rows])

    for name in ("similar", "tamsi", "sap", "connectors"):
        assert of(name) == (pytest.approx(100, abs=2), pytest.approx(100, abs=12)), name
    coulomb, travel = of("lagged")
    assert coulomb > 200
    assert travel < 70
    assert of("lagged.soft")[0] < coulomb - 50


def test_the_fit_finds_the_friction_of_simulated_tosses(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = make_toss_diagram(BOXES._replace(friction=0.2))
    flown = [(toss, fly(truth, toss)) for toss in tosses()[:4]]
    made = [one._replace(orientation=f.orientation, position=f.position) for one, f in flown]
    monkeypatch.setattr(tossed, "recorded", lambda: made)
    few = MeasuredTossScenario(
        tosses=2, settings=("similar",), variations=(), frictions=(0.18, 0.2, 0.22)
    )
    metrics = tossed.run(few, 0, quiet).metrics
    assert metrics["friction"].value == pytest.approx(0.2, abs=2e-3)
    assert metrics["similar.travel"].value == pytest.approx(100, abs=3)


def test_a_fit_is_the_parabolas_vertex_or_the_end() -> None:
    values, noise = [1.0, 2.0, 4.0], np.random.default_rng(0).normal(0, 0.1, (50, 1))
    found = tossed.fit(values, (np.array(values) - 2.3 - noise) ** 2, 0)
    assert found[1] < 2.3 < found[2]
    assert found[0] == pytest.approx(2.3 + noise.mean(), abs=1e-9)
    assert tossed.fit(values, np.array([[3.0, 2.0, 1.0]]), 0) == (4.0, 4.0, 4.0)


def test_no_toss_is_both_fitted_and_judged() -> None:
    scenario = MeasuredTossScenario(tosses=100)
    both = [{tossed.recorded()[k].number for k in scenario.half(odd)} for odd in (0, 1)]
    assert [{number % 2 for number in one} for one in both] == [{0}, {1}]
    assert [len(one) for one in both] == [50, 50]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tosses": 3}, "tosses is 3, allowed: an even number from 2 to 200"),
        ({"settings": ()}, "settings is (), allowed: at least one"),
        ({"frictions": (0.2, 0.1)}, "frictions is (0.2, 0.1), allowed: rising numbers > 0"),
        ({"friction": 0.0}, "friction is 0.0, allowed: a finite number > 0"),
    ],
)
def test_what_cannot_be_tried_is_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        MeasuredTossScenario(**given)
