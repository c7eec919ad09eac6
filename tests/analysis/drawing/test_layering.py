from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.drawing.layering import (
    Link,
    assign_layers,
    feedback,
    longest_paths,
    order_layers,
)

Pairs = list[tuple[int, int]]
pairs_of_numbers = st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=20)


def never(_: object) -> bool:
    return False


@given(pairs_of_numbers)
def test_layers_increase_along_what_is_no_feedback(pairs: Pairs) -> None:
    keys = list(range(8))
    found = feedback(keys, pairs, never)
    forward = [pair for i, pair in enumerate(pairs) if i not in found and pair[0] != pair[1]]
    layer = assign_layers(keys, forward, never, never)
    assert all(layer[source] < layer[target] for source, target in forward)
    assert set(layer.values()) == set(range(max(layer.values()) + 1))


@given(pairs_of_numbers)
def test_without_cycles_there_is_no_feedback(pairs: Pairs) -> None:
    acyclic = [(min(pair), max(pair)) for pair in pairs]
    assert feedback(list(range(8)), acyclic, never) == set()


def test_the_loop_is_cut_where_the_reference_enters() -> None:
    pairs = [("noise", "camera"), ("camera", "sum"), ("reference", "sum"), ("sum", "plant")]
    pairs.append(("plant", "camera"))
    keys = ["noise", "camera", "reference", "sum", "plant"]
    found = feedback(keys, pairs, lambda key: key == "sum")
    assert [pairs[i] for i in found] == [("camera", "sum")]


def test_what_works_in_parallel_stands_in_parallel() -> None:
    pairs = [("plan", "left"), ("plan", "right"), ("left", "contact"), ("right", "contact")]
    pairs += [("contact", "left"), ("contact", "right")]
    keys = ["plan", "left", "right", "contact"]
    found = feedback(keys, pairs, never)
    assert [pairs[i] for i in sorted(found)] == [("contact", "left"), ("contact", "right")]


def test_a_disturbance_stands_before_its_target() -> None:
    pairs = [("a", "b"), ("b", "c"), ("noise", "filter"), ("filter", "c")]
    layer = assign_layers(["a", "b", "c", "noise", "filter"], pairs, never, never)
    assert (layer["noise"], layer["filter"], layer["c"]) == (0, 1, 2)
    layer = assign_layers(["a", "b", "c", "noise"], [*pairs[:2], ("noise", "c")], never, never)
    assert layer["noise"] == 1


def test_ends_of_the_picture_have_layers_of_their_own() -> None:
    pairs = [("in", "a"), ("a", "b"), ("a", "out")]
    layer = assign_layers(
        ["in", "a", "b", "c", "out"], pairs, lambda key: key == "in", lambda key: key == "out"
    )
    assert [key for key in layer if layer[key] == 0] == ["in"]
    assert [key for key in layer if layer[key] == max(layer.values())] == ["out"]


def test_longest_paths_count_wires() -> None:
    before, after = longest_paths("abcd", [("a", "b"), ("b", "c"), ("a", "c"), ("c", "d")])
    assert before == {"a": 0, "b": 1, "c": 2, "d": 3}
    assert after == {"a": 3, "b": 2, "c": 1, "d": 0}


def test_crossings_are_undone() -> None:
    links = [Link("a", "y"), Link("b", "x")]
    left, right = order_layers([["a", "b"], ["x", "y"]], links)
    assert left.index("a") - left.index("b") == right.index("y") - right.index("x")


def test_fixed_ports_decide_the_order() -> None:
    links = [Link("a", "x", 0.9, 0.0), Link("a", "y", 0.1, 0.0)]
    assert order_layers([["a"], ["x", "y"]], links) == [["a"], ["y", "x"]]
