"""Units for co-simulation are valid, and run in a loop as what was simulated."""

import ctypes
import io
import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
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
LAW = CompensatorLaw(CompensatorParams(axes=(AXIS,), period=PERIOD))
ERROR, VALID, DESIRED, COMPENSATION = 0, 1, 2, 3  # references

needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("fmu") / "unit.fmu"
    path.write_bytes(make())
    return path


def make(found: str | None = compiler()) -> bytes:
    return fmu(LawInC("compensator", "fsm", LAW), "step-response", tool="Chamfer", compiler=found)


@contextmanager
def running(unit: Path, said: list[str], **options: Any) -> Iterator[FMU2Slave]:
    """Give an instance that has been initialised, and keep what it logs."""
    folder = tempfile.mkdtemp(dir=unit.parent)  # a library in use is not to be written again
    description = fmpy.read_model_description(unit)
    slave = FMU2Slave(
        guid=options.get("guid", description.guid),
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=fmpy.extract(unit, folder),
        instanceName="one",
    )
    logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(lambda *told: said.append(told[-1].decode()))
    callbacks = fmpy.fmi2.fmi2CallbackFunctions(logger=logger)
    fmpy.fmi2.addLoggerProxy(ctypes.byref(callbacks))
    slave.instantiate(callbacks=callbacks)
    slave.setupExperiment(startTime=options.get("start", 0.0))
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    yield slave
    slave.terminate()
    slave.freeInstance()


def test_a_unit_is_valid_and_its_bytes_are_those_of_its_law(unit: Path) -> None:
    assert validate_fmu(str(unit)) == []
    assert unit.read_bytes() == make()
    held = zipfile.ZipFile(unit).namelist()
    assert "modelDescription.xml" in held
    assert {"sources/compensator.c", "sources/compensator.h", "sources/fmu.c"} <= set(held)
    sources = io.BytesIO(make(None))
    assert not any("binaries" in name for name in zipfile.ZipFile(sources).namelist())
    assert fmpy.read_model_description(sources).guid == fmpy.read_model_description(unit).guid


@needs_compiler
def test_a_unit_has_every_function_of_the_standard_and_no_other(
    unit: Path, tmp_path: Path
) -> None:
    header = Path(fmpy.__file__).parent / "c-code/fmi2FunctionTypes.h"
    text = header.read_text("utf-8").partition("Functions for FMI2 for Model Exchange")
    common, _, rest = text
    of_co_simulation = rest.partition("Functions for FMI2 for Co-Simulation")[2]
    wanted = set(re.findall(r"typedef .*?(fmi2\w+)TYPE\s*\(", common + of_co_simulation))
    assert {"fmi2DoStep", "fmi2GetFMUstate", "fmi2GetStringStatus"} <= wanted
    fmpy.extract(unit, tmp_path)
    (library,) = tmp_path.glob("binaries/linux64/*.so")
    loaded = ctypes.CDLL(str(library))
    assert [name for name in sorted(wanted) if not hasattr(loaded, name)] == []
    assert not hasattr(loaded, "compensator_step")  # of two units in one process


@needs_compiler
def test_a_unit_closes_the_loop_as_the_diagram_does(unit: Path) -> None:
    diagram = make_servo_diagram(SCENARIO, loops=("fsm",), step=SCENARIO.step)
    run = simulate(diagram, duration=SCENARIO.duration, step=PERIOD)
    plant = fuse(make_plant(SCENARIO.plant, "position"))
    a, b, c, _, _ = cont2discrete((plant.A(), plant.B(), plant.C(), plant.D()), PERIOD)
    x, traced = np.zeros(len(a)), []
    with running(unit, []) as slave:
        for i in range(len(run.time)):
            (actual,) = c @ x
            traced.append(actual)
            slave.setReal([ERROR], [seen(1.0 - actual, 0.0, 0.0, SCENARIO.camera.resolution)])
            slave.doStep(i * PERIOD, PERIOD)
            x = a @ x + b @ slave.getReal([COMPENSATION])
    np.testing.assert_allclose(traced, run.outputs["fsm.actual_trajectory"], rtol=0, atol=1e-12)
    assert traced[-1] == pytest.approx(1.0, abs=0.01)


@needs_compiler
def test_instances_know_nothing_of_each_other_and_begin_anew(unit: Path) -> None:
    with running(unit, []) as one, running(unit, []) as other:
        one.setReal([ERROR], [1.0])
        other.setReal([ERROR, VALID], [1.0, 0.0])
        one.doStep(0.0, 3 * PERIOD)  # three ticks
        other.doStep(0.0, PERIOD)
        assert one.getReal([COMPENSATION]) == [AXIS.increment + AXIS.increment + AXIS.increment]
        assert other.getReal([COMPENSATION]) == [0.0]
        one.reset()
        assert one.getReal([ERROR, VALID, COMPENSATION]) == [0.0, 1.0, 0.0]


@needs_compiler
@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda unit: unit.doStep(0.0, PERIOD / 2), "the step is not a whole number of periods"),
        (lambda unit: unit.doStep(0.0, 0.0), "the step is not a whole number of periods"),
        (lambda unit: unit.doStep(0.0, np.nan), "the step is not a whole number of periods"),
        (lambda unit: unit.doStep(PERIOD, PERIOD), "not that at which the last step ended"),
        (lambda unit: unit.setReal([COMPENSATION], [1.0]), "only inputs can be set"),
        (lambda unit: unit.getReal([99]), "there is no such variable"),
        (lambda unit: unit.getFMUstate(), "this function is not supported"),
        (
            lambda unit: (unit.setReal([DESIRED], [np.nan]), unit.doStep(0.0, PERIOD)),
            "the desired trajectory is not finite",
        ),
    ],
)
def test_what_a_unit_refuses_it_says(
    wrong: Callable[[FMU2Slave], Any], why: str, unit: Path
) -> None:
    said: list[str] = []
    with running(unit, said) as slave:
        with pytest.raises(FMICallException):
            wrong(slave)
        assert why in said[-1]


@needs_compiler
def test_a_unit_of_another_law_and_an_odd_start_are_refused(unit: Path) -> None:
    said: list[str] = []
    with pytest.raises(Exception, match="instantiate"), running(unit, said, guid="other"):
        pass
    assert "GUID" in said[-1]
    with pytest.raises(FMICallException), running(unit, said, start=PERIOD / 3):
        pass
    assert "whole number of periods" in said[-1]
