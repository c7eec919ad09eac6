"""The site hides what every executed page repeats."""

import pytest

shell = pytest.importorskip("docs._ext.page_shell", reason="the extra docs is not installed")


@pytest.mark.parametrize(
    ("code", "hidden"),
    [
        ('from IPython.display import SVG\n\nSVG(filename="a.svg")', True),
        ('SVG(filename="a.svg")', True),
        ("draw()\nSVG(filename='a.svg')", False),
        ("%%bash\nls", False),
        ("", False),
    ],
)
def test_an_input_that_only_shows_a_picture_is_hidden(code: str, hidden: bool) -> None:
    assert shell.only_shows_a_picture(code) is hidden


def test_the_line_that_calls_the_shell_is_hidden() -> None:
    page = shell.nodes.paragraph()
    page += shell.nodes.literal_block("", "%%bash\nchamfer list\n")
    shell.hide_boilerplate(page)
    assert page.astext() == "chamfer list\n"


def test_a_long_name_in_a_table_breaks_and_stays_the_same_text() -> None:
    page = shell.nodes.entry()
    page += shell.nodes.literal("", "pid.rise_time")
    shell.break_names(page)
    assert page.astext().replace("<wbr>", "") == "pid.rise_time"
    assert page.astext().count("<wbr>") == 3
