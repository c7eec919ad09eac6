"""The paper's stability criteria, Tarraf's and Gore's, checked on the compensator's own charts."""

import math
from dataclasses import replace

from chamfer.systems.servo.compensator import (
    AxisMemory,
    AxisParams,
    CompensatorChart,
    CompensatorInputs,
    CompensatorMemory,
    CompensatorParams,
    make_axis_chart,
    make_compensator_chart,
)
from chamfer.systems.statechart.chart import Chart, Snapshot, Transition
from chamfer.systems.statechart.chart_design import not_connected, not_local, not_used, replay
from chamfer.systems.statechart.finite_machine import FiniteMachine, explore

_LEVELS = 4  # large increments up to the limit; the machine is finite because it is limited


def axis_machine(axis: AxisParams, *, accumulated: bool) -> FiniteMachine:
    """Return the finite machine that the chart of one axis is.

    Its inputs are the five classes of the error. With ``accumulated`` the total compensation, in
    small increments, is state and output; otherwise the output is the increment and the total,
    which no later increment depends on, is left out of the state.
    """
    limited = replace(axis, limit=_LEVELS * axis.increment)
    chart = make_axis_chart(limited)
    small = axis.small_increment
    errors = (0.0, axis.dead_zone, axis.large_error, -axis.dead_zone, -axis.large_error)

    def step(state: tuple[str, int], error: float) -> tuple[tuple[str, int], float]:
        name, level = state
        snapshot = Snapshot(name, 0.0, AxisMemory(level * small, 0.0), True)
        following, _ = chart.step(snapshot, error, 0.0)
        total = round(following.memory.compensation / small)
        if accumulated:
            return (following.state, total), float(total)
        return (following.state, 0), following.memory.increment / small

    return explore((chart.initial, 0), errors, step, input_size=[abs(error) for error in errors])


def lap_chart(params: CompensatorParams) -> CompensatorChart:
    """Return Fig. 3 as it is drawn: every lap begins in, and returns to, the initial state.

    The chart that runs does a lap in one tick and does not return. Here a lap takes two ticks,
    the first decides as the one tick does and the second returns.
    """
    folded = make_compensator_chart(params)
    decide = [replace(transition, source=folded.initial) for transition in folded.transitions]
    returns: list[Transition[CompensatorInputs, CompensatorMemory]] = [
        Transition(
            source=state.name, target=folded.initial, guard=lambda _: True, label="next lap"
        )
        for state in folded.states
        if state.name != folded.initial and state.outcome is None
    ]
    return Chart(
        folded.name,
        states=folded.states,
        transitions=[*decide, *returns],
        memory=folded.memory,
    )


def gore_findings(
    axis: AxisParams, errors: list[float], period: float, *, folded: bool
) -> tuple[str, ...]:
    """Return what contradicts Gore's two criteria in the compensator's charts, in words.

    Args:
        axis: The compensator's axis.
        errors: A closed-loop run's errors, m, one per tick.
        period: s, of the ticks.
        folded: Whether the chart of Fig. 3 is the one that runs, with a lap in one tick, or as
            it is drawn.

    The trajectory ends with the run, and a tenth of it is lost to the camera.
    """
    blind = range(len(errors) // 2, len(errors) // 2 + len(errors) // 10)
    seen = [math.nan if i in blind else error for i, error in enumerate(errors)]
    params = CompensatorParams(axes=(axis,), period=period, end_time=(len(errors) - 1) * period)
    fig3 = make_compensator_chart(params) if folded else lap_chart(params)
    ticks = 1 if folded else 2  # of a lap
    fig3_inputs = [CompensatorInputs((error,), None, None) for error in seen for _ in range(ticks)]
    fig4 = make_axis_chart(axis)
    fig4_inputs = [error for error in seen if math.isfinite(error)]
    local = [
        *not_local(fig3, fig3_inputs, period=period / ticks),
        *not_local(fig4, fig4_inputs, period=period),
    ]
    unused = [
        *not_used(fig3, replay(fig3, fig3_inputs, period=period / ticks)),
        *not_used(fig4, replay(fig4, fig4_inputs, period=period)),
    ]
    apart = [*not_connected(fig3), *not_connected(fig4)]
    findings = []
    if local:
        findings.append(f"criterion 1: the rest depends on what {', '.join(local)} does")
    if unused or apart:
        ways = [f"no way from {start} to {end}" for start, end in apart]
        findings.append(
            "criterion 2: " + ", ".join([f"{name} not used" for name in unused] + ways)
        )
    return tuple(findings)
