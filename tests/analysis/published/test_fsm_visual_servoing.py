from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED


def test_every_value_has_a_source_and_says_what_kind_it_is() -> None:
    for value in PUBLISHED:
        assert value.source
        assert value.kind in ("predicted", "calibrated")


def test_no_value_is_given_twice() -> None:
    keys = [(value.experiment, value.metric) for value in PUBLISHED]
    assert len(keys) == len(set(keys))
