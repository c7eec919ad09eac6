"""Units for co-simulation are valid, and run in a loop as what was simulated."""

import io
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu
from scipy.signal import cont2discrete

from chamfer.analysis.export.c_code import LawInC
from chamfer.analysis.export.fmu import compiler, fmu
from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.servo_loops import make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import STEP, fsm_axis, resolve
from chamfer.systems.exact_discretisation import fuse
from chamfer.systems.servo.compensator_law import CompensatorLaw, CompensatorParams
from chamfer.systems.servo.servo_plant import make_plant
from chamfer.systems.vision.measured_error import seen

SCENARIO = resolve(STEP)
PERIOD = SCENARIO.fsm.period
AXIS = fsm_axis(SCENARIO, "position")
LAW = LawInC("compensator", CompensatorLaw(CompensatorParams(axes=(AXIS,), period=PERIOD)))
ERROR, VALID, DESIRED, COMPENSATION = 0, 1, 2, 3  # references

needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


def made(by: str | None) -> bytes:
    return fmu(LAW, "step-response", tool="Chamfer", compiler=by)


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("fmu") / "unit.fmu"
    path.write_bytes(made(compiler()))
    return path


@contextmanager
def running(unit: Path, said: list[str], guid: str = "", start: float = 0.0) -> Iterator[Any]:
    """Give an instance that has been initialised, and keep what it logs."""
    about = fmpy.read_model_description(unit)
    about.guid = guid or about.guid
    folder = fmpy.extract(unit, tempfile.mkdtemp(dir=unit.parent))
    instance = instantiate_fmu(folder, about, logger=lambda *told: said.append(told[-1].decode()))
    instance.setupExperiment(startTime=start)
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    yield instance
    instance.terminate()
    instance.freeInstance()


def test_a_unit_is_valid_and_its_bytes_are_those_of_its_law(unit: Path) -> None:
    assert validate_fmu(str(unit)) == []
    assert unit.read_bytes() == made(compiler())
    sources = io.BytesIO(made(None))
    assert fmpy.supported_platforms(sources) == ["c-code"]
    assert fmpy.read_model_description(sources).guid == fmpy.read_model_description(unit).guid


@needs_compiler
def test_a_unit_closes_the_loop_as_the_diagram_does(unit: Path) -> None:
    diagram = make_servo_diagram(SCENARIO, loops=("fsm",), step=SCENARIO.step)
    run = simulate(diagram, duration=SCENARIO.duration, step=PERIOD)
    plant = fuse(make_plant(SCENARIO.plant, "position"))
    a, b, c, *_ = cont2discrete((plant.A(), plant.B(), plant.C(), plant.D()), PERIOD)
    x, traced = np.zeros(len(a)), []
    with running(unit, []) as one:  # FMPy asks for every function of the standard
        assert not hasattr(one.dll, "compensator_step")  # of two units in one process
        for i in range(len(run.time)):
            traced.append(float((c @ x)[0]))
            one.setReal([ERROR], [seen(1.0 - traced[-1], 0, 0, SCENARIO.camera.resolution)])
            one.doStep(i * PERIOD, PERIOD)
            x = a @ x + b @ one.getReal([COMPENSATION])
    np.testing.assert_allclose(traced, run.outputs["fsm.actual_trajectory"], rtol=0, atol=1e-12)
    assert traced[-1] == pytest.approx(1.0, abs=0.01)


@needs_compiler
def test_instances_know_nothing_of_each_other_and_begin_anew(unit: Path) -> None:
    with running(unit, []) as one, running(unit, [], start=2 * PERIOD) as other:
        one.setReal([ERROR], [1.0])
        other.setReal([ERROR, VALID], [1.0, 0.0])
        one.doStep(0.0, 2 * PERIOD)  # two ticks
        other.doStep(2 * PERIOD, PERIOD)
        assert one.getReal([COMPENSATION]) == [2 * AXIS.increment]
        assert other.getReal([COMPENSATION]) == [0.0]
        one.reset()
        assert one.getReal([ERROR, VALID, COMPENSATION]) == [0.0, 1.0, 0.0]


REFUSED: dict[str, Callable[[Any], Any]] = {
    "the step is not a whole number of periods": lambda unit: unit.doStep(0.0, PERIOD / 2),
    "the time is not that at which the last step": lambda unit: unit.doStep(PERIOD, PERIOD),
    "only inputs can be set": lambda unit: unit.setReal([COMPENSATION], [1.0]),
    "there is no such variable": lambda unit: unit.getReal([99]),
    "this function is not supported": lambda unit: unit.getFMUstate(),
    "the desired trajectory is not finite": lambda unit: (
        unit.setReal([DESIRED], [np.nan]) or unit.doStep(0.0, PERIOD)
    ),
}


@needs_compiler
def test_what_a_unit_refuses_it_says(unit: Path) -> None:
    said: list[str] = []
    for why, wrong in REFUSED.items():
        with pytest.raises(FMICallException), running(unit, said) as one:
            wrong(one)
        assert why in said[-1]
    with pytest.raises(FMICallException), running(unit, said, start=PERIOD / 3):
        pass
    assert "the start is not a whole number of periods" in said[-1]
    with pytest.raises(Exception, match="Failed to instantiate"), running(unit, said, guid="no"):
        pass
    assert "the GUID is not that of this unit" in said[-1]
