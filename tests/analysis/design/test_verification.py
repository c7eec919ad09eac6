import pytest

from chamfer.analysis.design.design import Design, contradiction, interval
from chamfer.analysis.design.link import at_most


def design(verdict: str, low: float = 0.0, high: float = 1.0) -> Design:
    link = at_most("one", 1.0, 2.0, "", "")
    return Design(
        links=(link,),
        verdict=verdict,  # type: ignore[arg-type]
        limiting_link="one",
        share=0.5,
        share_low=low,
        share_high=high,
        draws=10,
    )


def test_interval_is_that_of_clopper_and_pearson() -> None:
    # All of n: the lower end p has p^n = 2.5 %.
    low, high = interval(20, 20)
    assert (low, high) == (pytest.approx(0.025 ** (1 / 20)), 1.0)
    low, high = interval(0, 20)
    assert (low, high) == (0.0, pytest.approx(1 - 0.025 ** (1 / 20)))


@pytest.mark.parametrize(
    ("verdict", "seated", "contradicted"),
    [("certain", 20, False), ("certain", 19, True), ("no", 0, False), ("no", 1, True)],
)
def test_a_single_insertion_contradicts_what_is_sure(
    verdict: str, seated: int, contradicted: bool
) -> None:
    said = contradiction(design(verdict), seated, 20)
    assert bool(said) == contradicted
    if contradicted:
        assert f"called {verdict!r}, but 1 of 20" in said


def test_intervals_of_what_is_likely_have_to_overlap() -> None:
    assert not contradiction(design("likely", 0.4, 0.8), 19, 20)
    assert "40 to 60 % of the errors inside" in contradiction(design("likely", 0.4, 0.6), 20, 20)
    assert contradiction(design("likely", 0.4, 0.6), 2, 20)
