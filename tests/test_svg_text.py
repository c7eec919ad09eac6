"""The text of a picture is measured as a page shows it."""

import pytest
from docs._ext.svg_text import shown

from chamfer.analysis.drawing.figure_style import dress, new_figure
from chamfer.analysis.report.results import figure_files


@pytest.mark.parametrize(("width", "size"), [(4.0, 32 / 3), (8.0, 8 * 736 / 576), (16.0, 5.11)])
def test_letters_of_a_figure_shrink_with_it_to_the_page(width: float, size: float) -> None:
    figure = new_figure(width, 3.0)
    dress(figure.subplots(), title="Path $x_1$", x="time / s", y="position / m")
    found = shown(figure_files({"path": figure})["path.svg"])
    assert found.width == pytest.approx(96 * width)
    assert found.text == pytest.approx(size, rel=1e-3)


def test_letters_of_a_drawing_are_its_own() -> None:
    text = '<text font-size="13">q<tspan font-size="9">1</tspan></text>'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" width="920" viewBox="0 0 920 9">{text}</svg>'
    assert shown(svg).text == pytest.approx(13 * 736 / 920)
    assert shown(svg.replace(text, "")).text == float("inf")
