"""When a fault acts."""

from chamfer.systems.charging.crucible_world import CutOff, FaultTrigger, FaultTriggerParams


def test_fault_acts_once_and_after_its_delay() -> None:
    params = FaultTriggerParams(state=3, item=1, delay=0.01, duration=0.015)
    trigger = FaultTrigger(params)
    context = trigger.CreateDefaultContext()
    active = []
    for state, item in [(3, 0), (2, 1), *3 * [(3, 1)], *5 * [(4, 1)], *4 * [(3, 1)]]:
        trigger.GetInputPort("state").FixValue(context, [float(state)])
        trigger.GetInputPort("item").FixValue(context, [float(item)])
        context.SetDiscreteState(trigger.EvalUniquePeriodicDiscreteUpdate(context))
        active.append(trigger.GetOutputPort("active").Eval(context)[0])
    assert active == [0, 0, 0, 0, 1, 1, 1, *7 * [0]]


def test_a_cut_line_reads_nothing() -> None:
    line = CutOff(2)
    context = line.CreateDefaultContext()
    line.GetInputPort("signal").FixValue(context, [1.0, -2.0])
    for cut, reading in ((0.0, [1.0, -2.0]), (1.0, [0.0, 0.0])):
        line.GetInputPort("cut").FixValue(context, [cut])
        assert line.GetOutputPort("reading").Eval(context).tolist() == reading
        assert line.GetOutputPort("alive").Eval(context)[0] == 1 - cut
