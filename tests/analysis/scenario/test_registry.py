from pathlib import Path

import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.registry import (
    Sources,
    find,
    load,
    load_paper,
    select,
    select_paper,
)

ENTRY = """
{attribute} = Experiment(
    name="{name}", paper="{paper}", figure="Fig. 1", summary="one " "line", run=undefined_name
)
"""


def sources(tmp_path: Path, **modules: str) -> Sources:
    (tmp_path / "room").mkdir()
    for name, text in modules.items():
        (tmp_path / "room" / f"{name}.py").write_text(text)
    return Sources(folder=tmp_path, package="some.package")


def test_finds_entries_without_running_the_module(tmp_path: Path) -> None:
    text = "raise RuntimeError('was run')\n" + ENTRY.format(attribute="A", name="a", paper="p")
    (entry,) = find(sources(tmp_path, module=text))
    assert (entry.name, entry.paper, entry.figure) == ("a", "p", "Fig. 1")
    assert entry.summary == "one line"
    assert (entry.module, entry.attribute) == ("some.package.room.module", "A")


def test_order_is_by_paper_then_by_source(tmp_path: Path) -> None:
    def entry(name: str, paper: str) -> str:
        return ENTRY.format(attribute=name.upper(), name=name, paper=paper)

    found = find(
        sources(
            tmp_path,
            b=entry("z", "first") + entry("y", "second"),
            a=entry("x", "second") + entry("w", "first"),
        )
    )
    assert [one.name for one in found] == ["w", "z", "x", "y"]


def test_within_a_paper_figure_9_comes_before_figure_10(tmp_path: Path) -> None:
    modules = {
        f"m{i}": ENTRY.format(attribute="A", name=f"e{i}", paper="p").replace("Fig. 1", figure)
        for i, figure in enumerate(("section 3", "Fig. 10", "Fig. 9", "Fig. 8"))
    }
    found = find(sources(tmp_path, **modules))
    assert [one.figure for one in found] == ["Fig. 8", "Fig. 9", "Fig. 10", "section 3"]


@pytest.mark.parametrize(
    "text",
    [
        "A: Experiment[int] = Experiment(name='a', paper='p', figure='', summary='s')",
        "A = Experiment[int](name='a', paper='p', figure='', summary='s')",
    ],
)
def test_annotated_and_parametrised_experiments_are_found(tmp_path: Path, text: str) -> None:
    assert [entry.attribute for entry in find(sources(tmp_path, module=text))] == ["A"]


def test_other_assignments_are_not_experiments(tmp_path: Path) -> None:
    text = "a: int\nb = Other(name='b')\nc = module.Experiment\nd = [Experiment]\n"
    assert find(sources(tmp_path, module=text)) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "\nA = Experiment(name=NAME, paper='p', figure='', summary='s')",
            "/module.py: line 2: A: name has to be a plain string among the keywords, "
            "listing reads it without running the module",
        ),
        (
            "A = Experiment(name='a', paper='p', summary='s')",
            "/module.py: line 1: A: figure has to be a plain string among the keywords, "
            "listing reads it without running the module",
        ),
        (
            "A = Experiment(name='../a', paper='p', figure='', summary='s')",
            "/module.py: line 1: A: name is '../a', allowed: lower-case letters, digits and "
            "single dashes between them",
        ),
        (
            "A = B = Experiment(name='a', paper='p', figure='', summary='s')",
            "/module.py: line 1: an experiment is assigned to one plain name",
        ),
        ("A = Experiment(\n", "/module.py: line 1: '(' was never closed"),
    ],
)
def test_unreadable_source_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(UserError) as raised:
        find(sources(tmp_path, module=text))
    assert str(raised.value) == "room" + message


def test_a_name_twice_is_refused(tmp_path: Path) -> None:
    text = ENTRY.format(attribute="A", name="a", paper="p")
    with pytest.raises(UserError) as raised:
        find(sources(tmp_path, one=text, two=text))
    expected = "two experiments are named 'a': some.package.room.one.A and some.package.room.two.A"
    assert str(raised.value) == expected


def test_select_keeps_the_order_asked_for_and_drops_repetitions(toys: Sources) -> None:
    chosen = select(find(toys), ["trials", "fall", "trials"])
    assert [entry.name for entry in chosen] == ["trials", "fall"]


@pytest.mark.parametrize(("name", "suggestion"), [("fal", ", did you mean 'fall'?"), ("zzz", ",")])
def test_unknown_experiment_lists_the_valid_names(
    toys: Sources, name: str, suggestion: str
) -> None:
    with pytest.raises(UserError) as raised:
        select(find(toys), ["fall", name])
    assert str(raised.value) == (
        f"unknown experiment {name!r}{suggestion} valid names: "
        "interrupted, broken, asserting, slow, fall, trials"
    )


def test_unknown_paper_lists_the_valid_ones(toys: Sources) -> None:
    with pytest.raises(UserError) as raised:
        select_paper(find(toys), "toy-papers")
    assert str(raised.value) == (
        "unknown paper 'toy-papers', did you mean 'toy-paper'? "
        "valid names: other-paper, slow-paper, toy-paper"
    )


def test_load_imports_the_experiment(toys: Sources) -> None:
    (entry,) = select(find(toys), ["fall"])
    experiment = load(entry)
    assert experiment.name == "fall"
    assert experiment.scenario().height == 5.0


def test_paper_without_a_module_has_no_published_values(toys: Sources) -> None:
    paper = load_paper("other-paper", toys)
    assert (paper.title, paper.published) == ("other-paper", ())
    assert load_paper("toy-paper", toys).title == "On <falling> & landing"


def test_missing_import_inside_a_papers_module_is_not_hidden(toys: Sources) -> None:
    published = toys.folder / "published"
    (published / "bad_paper.py").write_text("import no_such_module_anywhere\n")
    with pytest.raises(ModuleNotFoundError, match="no_such_module_anywhere"):
        load_paper("bad-paper", toys)
