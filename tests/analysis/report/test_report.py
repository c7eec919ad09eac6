import base64
import json
import re
import threading
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin, urlsplit

import pytest

from chamfer.analysis.report.atomic_write import locked
from chamfer.analysis.report.report import report_text, write_report
from chamfer.analysis.report.results import json_text
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry

SVG = "<svg xmlns='http://www.w3.org/2000/svg' width='10' height='10'/>"
VOID = {"meta", "img", "wbr", "br"}


def known(*names: str, published: str = "none") -> Catalogue:
    """Experiments of a paper."""
    about = {"paper": "toy-paper", "figure": "Fig. 1", "module": "", "scenario": ""}
    entries = [Entry(name=name, summary=f"{name} & co", **about) for name in names]
    return Catalogue(entries=tuple(entries), published=published)


NONE = known()


def check(**changes: Any) -> dict[str, Any]:
    return {
        "metric": "pid.rise_time",
        "relation": "near",
        "published": 0.00888,
        "tolerance": 1e-5,
        "measured": 0.008881,
        "unit": "s",
        "kind": "calibrated",
        "source": "section 3, <Fig. 8>",
        "verdict": "holds",
        "ok": True,
        "note": "",
        **changes,
    }


def result(name: str = "fall", **changes: Any) -> dict[str, Any]:
    return {
        "experiment": name,
        "paper": "toy-paper",
        "figure": "Fig. 1",
        "seed": 3,
        "scenario": {"plant": {"mass": 2.0}, "duration": None},
        "scenario_sha256": "0123456789abcdef",
        "overrides": [],
        "versions": {"drake": "1.51", "chamfer": None},
        "metrics": {"gain": {"value": None, "unit": "dB", "note": "it <never> settles"}},
        "checks": [],
        "simulated_seconds": 2.5,
        "wall_seconds": 0.03,
        "command": f"chamfer run {name}",
        "figures": ["response.svg", "response.png"],
        "drawings": ["diagram.svg"],
        **changes,
    }


def put(out: Path, document: dict[str, Any], folder: str | None = None) -> None:
    where = out / (folder or document["experiment"])
    where.mkdir(parents=True)
    (where / "response.svg").write_text(SVG)
    (where / "diagram.svg").write_text(SVG)
    (where / "result.json").write_text(json_text(document))


class Page(HTMLParser):
    """Checks that tags are balanced and collects what refers to something."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.given: dict[str, list[str]] = {"id": [], "href": [], "src": []}
        self.feed(text)
        assert self.open == []
        self.ids, self.links, self.images = self.given.values()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            self.given.get(name, []).append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def words(text: str) -> str:
    """Return the text between the tags, with single spaces."""
    text = re.sub(r"<style>.*?</style>|<wbr>", "", text, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", " ", text).split())


def test_page_is_self_contained_and_its_links_lead_somewhere(tmp_path: Path) -> None:
    for name in ("fall", "rise"):
        put(tmp_path, result(name, checks=[check(), check(verdict="does_not_hold", note="why")]))
    page = Page(report_text(tmp_path, known("fall", "rise")))
    assert not page.tags & {"script", "link", "iframe", "object"}
    assert len(page.ids) == len(set(page.ids))
    own = {link.removeprefix("#") for link in page.links if link.startswith("#")}
    assert own <= set(page.ids)
    assert all(
        (tmp_path / link).is_file() for link in set(page.links) - {f"#{one}" for one in own}
    )
    prefix = "data:image/svg+xml;base64,"
    images = [base64.b64decode(src.removeprefix(prefix)) for src in page.images]
    assert images == [SVG.encode()] * 4


def test_a_copied_result_is_shown_too_and_its_replay_linked_where_it_is(tmp_path: Path) -> None:
    put(tmp_path, result())
    put(tmp_path, result(replay="replay.html"), "a:b #1")
    (tmp_path / "a:b #1" / "replay.html").write_text("<p>the replay</p>")
    page = Page(report_text(tmp_path, NONE))
    assert {"fall", "a-b-1"} <= set(page.ids)
    (link,) = [one for one in page.links if one.endswith(".html")]
    url = urljoin((tmp_path / "index.html").as_uri(), link)
    assert Path(unquote(urlsplit(url).path)).read_text() == "<p>the replay</p>"


def test_a_replay_or_figure_that_is_missing_is_said_and_not_linked(tmp_path: Path) -> None:
    put(tmp_path, result(replay="replay.html"))
    put(tmp_path, result("rise", replay=None))
    (tmp_path / "fall" / "response.svg").unlink()
    text = report_text(tmp_path, NONE)
    assert "The figure response.svg is missing." in text
    assert "The 3-D replay replay.html is missing." in text
    assert words(text).count("3-D") == 1
    assert not [
        link for link in Page(text).links if not link.startswith("#") and "svg" not in link
    ]


def test_checks_show_published_beside_measured_and_the_verdict_in_words(tmp_path: Path) -> None:
    bound = {"relation": "at_least", "published": 1, "measured": None}
    limit = {"relation": "at_most", "published": 1, "kind": "specification"}
    checks = [
        check(),
        check(relation="at_most", published=1, measured=-2, unit="", kind="predicted"),
        check(**bound, verdict="does_not_hold", note="a <reason>"),
        check(measured=0.5, verdict="not_reached"),
        check(relation="between", low=1, high=2.5, measured=1.5, unit="%"),
        check(**limit, measured=1),
        check(**limit, measured=2, verdict="not_reached", ok=False),
    ]
    put(tmp_path, result(checks=checks))
    text = report_text(tmp_path, NONE)
    said = words(text)
    for row in (
        "0.00888 ± 1e−5 s 0.008881 s calibrated section 3, &lt;Fig. 8&gt; ✓ holds",  # noqa: RUF001
        "≤ 1 −2 predicted section 3, &lt;Fig. 8&gt; ✓ holds (not exceeded)",  # noqa: RUF001
        "≥ 1 s undefined s calibrated section 3, &lt;Fig. 8&gt; ✗ does not hold a &lt;reason&gt;",
        "0.5 s calibrated section 3, &lt;Fig. 8&gt; △ not reached",
        "1 to 2.5 % 1.5 % calibrated",
        "≤ 1 s 2 s specification section 3, &lt;Fig. 8&gt; ✗ broken",
        "3 of 5 published values reproduced (bounds kept by more than a factor of two: 1) 1 claim "
        "fails on the paper&#39;s own model 1 missed by our simulation 1 of 2 specifications kept",
        "fall Fig. 1 ✓&nbsp;3 ✗&nbsp;1 △&nbsp;1 ✗&nbsp;1 of 2 specifications kept",
    ):
        assert row in said


def test_a_figure_comes_before_its_checks_with_its_caption_and_opens_at_full_size(
    tmp_path: Path,
) -> None:
    put(tmp_path, result(checks=[check()], captions={"response.svg": "It falls <fast>."}))
    (tmp_path / "fall" / "diagram.svg").write_text("<svg><image/></svg>")
    text = report_text(tmp_path, NONE)
    figure, checks = text.index("<figcaption>It falls &lt;fast&gt;."), text.index('class="checks"')
    assert figure < checks < text.index("<figcaption>Block diagram")
    assert '<a href="fall/response.svg"><img class="drawn" alt="It falls &lt;fast&gt;."' in text
    assert '<img class="photo" alt="Block diagram"' in text


def test_sections_fold_and_the_first_is_open(tmp_path: Path) -> None:
    for name in ("fall", "rise"):
        put(tmp_path, result(name))
    folded = [report_text(tmp_path, NONE, running=one) for one in ("", "1 of 3")]
    assert [text.count('<details class="experiment" open>') for text in folded] == [1, 2]


def test_everything_that_is_needed_to_remake_it_is_there(tmp_path: Path) -> None:
    command = "chamfer run fall --set 'plant={mass: 3}' --seed 3"
    failed = [{"trial": trial, "seed": 0, "reason": "took <long>"} for trial in (3, 7)]
    changes = {"overrides": ["plant={mass: 3}"], "failed_trials": failed}
    put(tmp_path, result(command=command, **changes))
    said = words(report_text(tmp_path, known("fall")))
    for part in (
        "chamfer run fall --set &#39;plant={mass: 3}&#39; --seed 3",
        "Not the default scenario: plant={mass: 3} . Published values apply",
        "fall &amp; co",
        "2 trials failed, trial 3: took &lt;long&gt;. The numbers are of the trials",
        "plant.mass 2.0 duration null",
        "gain undefined dB it &lt;never&gt; settles",
        "drake 1.51, chamfer unknown",
        "seed 3, scenario 0123456789ab.",
    ):
        assert part in said


def test_order_is_the_registrys_by_paper_and_unknown_experiments_come_last(
    tmp_path: Path, toys: Catalogue
) -> None:
    for name, paper in (("z", "toy-paper"), ("b", "toy-paper"), ("a", "toy-paper"), ("y", "aa")):
        put(tmp_path, result(name, paper=paper))
    text = report_text(tmp_path, known("b", "z", "y", published=toys.published))
    page = Page(text)
    assert page.ids == ["contents", "paper-aa", "y", "paper-toy-paper", "b", "z", "a"]
    assert "On &lt;falling&gt; &amp; landing" in text


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "Expecting property name enclosed in double quotes"),
        ('{"a": 1}', "&#39;experiment&#39; is missing"),
        (json.dumps(result(metrics=3)), "has no len()"),
        (json.dumps(result(checks=[check(relation="like")])), "&#39;like&#39; is missing"),
        (json.dumps(result(figures=["../../secret.svg"])), "is not a file name"),
        (json.dumps(result(replay="../other.html")), "&#39;../other.html&#39; is not a file"),
    ],
)
def test_broken_or_foreign_results_are_listed_and_the_others_shown(
    tmp_path: Path, content: str, reason: str
) -> None:
    put(tmp_path, result())
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "result.json").write_text(content)
    text = report_text(tmp_path, NONE)
    assert 'id="fall"' in text
    assert "Unreadable results" in text
    (line,) = re.findall("<li>(.*?)</li>", text)
    assert line.startswith("foreign/result.json: ")
    assert reason in line


def test_a_design_is_shown_with_its_verdict_and_its_page(tmp_path: Path) -> None:
    folder = tmp_path / "design-fall"
    folder.mkdir()
    (folder / "map.svg").write_text(SVG)
    document = {
        **{name: result()[name] for name in ("paper", "figure", "versions")},
        "design": "fall",
        "verdict": "likely",
        "limiting_link": "a < b",
        "overrides": ["mass=2"],
        "figures": ["map.svg", "map.png"],
        "page": "design.html",
        "command": "chamfer design fall --set mass=2",
    }
    (folder / "result.json").write_text(json_text(document))
    html = report_text(tmp_path, NONE)
    assert "0 experiments, 1 design, no checks." in html
    assert "Verdict: <strong>likely</strong>, limited by a &lt; b." in html
    assert 'href="design-fall/design.html"' in html
    assert "Not the default scenario: <code>mass=2</code>." in html
    assert html.count("data:image/svg+xml") == 1
    assert "Unreadable" not in html


def test_a_result_that_appears_meanwhile_is_not_lost(tmp_path: Path) -> None:
    with locked(tmp_path):  # another run makes the page
        writer = threading.Thread(target=write_report, args=(tmp_path, NONE))
        writer.start()
        writer.join(timeout=0.5)
        put(tmp_path, result())
    writer.join(timeout=60)
    assert 'id="fall"' in (tmp_path / "index.html").read_text()


def test_a_page_of_a_run_that_goes_on_says_so_and_reloads_itself(tmp_path: Path) -> None:
    put(tmp_path, result("fall"))
    text = write_report(tmp_path, NONE, running="1 of 3, about 2 min left").read_text()
    assert "Running: 1 of 3, about 2 min left, at " in text
    assert '<meta http-equiv="refresh" content="10">' in text
    assert Page(text).ids[-1] == "fall"
    text = write_report(tmp_path / "empty", NONE).read_text()
    assert "refresh" not in text
    assert "0 experiments, no checks." in words(text)


def test_a_page_that_can_t_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "index.html").mkdir()
    with pytest.raises(UserError) as raised:
        write_report(tmp_path, NONE)
    assert str(raised.value) == f"{tmp_path}/index.html can't be written: Is a directory"
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]
