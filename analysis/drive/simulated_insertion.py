"""The robot of ``chamfer drive insertion --robot simulated``, a separate process."""

from contextlib import suppress
from dataclasses import replace

from chamfer.analysis.insertion.insertion import resolve_insertion
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    controller_of,
    make_insertion_robot,
)
from chamfer.systems.law_block import LawBlock
from chamfer.systems.robot.link import LinkError, served
from chamfer.systems.robot.remote_controller import RemoteController

_LOOKS = 4  # camera periods, after which all that is compiled is there


def main() -> None:
    """Simulate the cell for the parent process until it ends the run."""
    order, link = served()
    scenario = resolve_insertion(make_scenario(InsertionScenario(), given=order["scenario"]))
    with suppress(LinkError):  # then nobody is there to be told
        try:
            if order["rate"] is not None:
                _warm_up(scenario)
            waits, timeout = order["waits"], order["timeout"]
            controller = RemoteController(
                controller_of(scenario), link, waits=waits, timeout=timeout
            )
            run = simulate(
                make_insertion_robot(scenario, controller),
                duration=scenario.duration,
                step=scenario.step,
                seed=order["seed"],
                rate=order["rate"] or 0.0,
                ended=lambda _: controller.ended,
            )
            named = {name: values.tolist() for name, values in run.outputs.items()}
            link.send({"log": [], "time": run.time.tolist(), **named})
        except (ValueError, ArithmeticError, SystemExit) as error:
            link.fail(str(error))


def _warm_up(scenario: ResolvedInsertionScenario) -> None:
    """Compile the code of the first images, so that the robot keeps its time with them."""
    period = scenario.cameras.frames.period
    soon = replace(scenario, begin=period)
    diagram = make_insertion_robot(soon, LawBlock(controller_of(soon)))
    simulate(diagram, duration=_LOOKS * period, step=scenario.step)


if __name__ == "__main__":
    main()
