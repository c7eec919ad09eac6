from collections.abc import Callable
from pathlib import Path

import pytest

Chamfer = Callable[..., tuple[int, str, str]]


def files(out: Path) -> list[str]:
    return sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())


VALID = "valid names: interrupted, broken, asserting, slow, fall, trials"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "fal"], f"unknown experiment 'fal', did you mean 'fall'? {VALID}"),
        (["run", "fall", "x"], f"unknown experiment 'x', {VALID}"),
        (["diagram", "fall"], "fall has no block diagram"),
        (["diagram", "fall", "--chart"], "fall has no state chart"),
        (
            ["reproduce", "--paper", "x"],
            "unknown paper 'x', valid names: other-paper, slow-paper, toy-paper",
        ),
        (
            ["run", "fall", "trials", "--set", "noise=1"],
            "noise: no such field, valid fields: body, height, step (fall)",
        ),
        (["run", "fall", "--set", "height=200"], "height is 200.0, allowed: a number <= 100"),
        (
            ["run", "fall", "--scenario", "a.yaml", "--scenario", "b.yaml"],
            "--scenario is given twice, see chamfer run --help",
        ),
        (
            ["run", "fall", "--out", "/dev/null/a"],
            "--out is '/dev/null/a', which can't be written (Not a directory), allowed: a folder",
        ),
        (["run", "fall", "--scenario", "no.yaml"], "no.yaml: No such file or directory"),
        (
            ["run", "fall", "--seed", "4294967296"],
            "--seed is '4294967296', allowed: an integer from 0 to 4294967295",
        ),
        *(
            (
                ["reproduce", "--workers", text],
                f"--workers is {text!r}, allowed: an integer from 1 to 9999",
            )
            for text in ("0", "1.5", "")
        ),
        (["run"], "the following arguments are required: NAME, see chamfer run --help"),
        ([], "the following arguments are required: COMMAND, see chamfer --help"),
        (["reproduce", "--set", "a=1"], "unrecognized arguments: --set a=1, see chamfer --help"),
    ],
)
def test_mistakes_end_in_one_line_before_anything_is_made(
    chamfer: Chamfer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    assert chamfer(*arguments) == (2, "", f"chamfer: {message}\n")
    assert list((tmp_path / "cwd").iterdir()) == []


def test_results_that_a_run_replaces_are_named(chamfer: Chamfer, out: Path) -> None:
    status, _, err = chamfer("run", "trials", "--out", out)
    assert (status, err) == (0, "")
    *_, err = chamfer("run", "fall", "trials", "--out", out)
    assert err == f"chamfer: files in {out}/trials are replaced\n"


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["fall", "--set", "height=13"], 2, "fall: height is 13.0, allowed: a lucky number"),
        (
            ["broken", "--set", "noise=0.2"],
            2,
            "broken: can't be computed with noise=0.2: by zero",
        ),
        (
            ["asserting"],
            1,
            "asserting: stopped by Drake: Failure at plant.cc:1 in f(): condition 'x > 0' failed.",
        ),
    ],
)
def test_what_ends_a_run_is_one_line(
    chamfer: Chamfer, out: Path, arguments: list[str], status: int, message: str
) -> None:
    found, _, err = chamfer("run", *arguments, "--out", out)
    assert (found, err) == (status, f"chamfer: {message}\n")
    assert files(out) == []


def test_what_drake_refuses_is_one_line(chamfer: Chamfer, falling: Path, out: Path) -> None:
    falling.write_text(falling.read_text().replace("ZeroDivisionError(", "RuntimeError("))
    message = "chamfer: broken: stopped by Drake with noise=0.2: by zero\n"
    assert chamfer("run", "broken", "--set", "noise=0.2", "--out", out) == (1, "", message)


def test_a_bug_shows_its_traceback(chamfer: Chamfer, out: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        chamfer("run", "broken", "--out", out)


def test_a_disk_that_is_full_is_one_line(
    chamfer: Chamfer, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    message = f"chamfer: {out}/trials can't be written: No space left on device\n"
    assert chamfer("run", "trials", "--out", out) == (2, "", message)
    assert files(out) == []


INTERRUPTED = "chamfer: interrupted; finished experiments and trials are kept\n"


def test_an_interrupted_run_keeps_what_had_ended(chamfer: Chamfer, out: Path) -> None:
    status, _, err = chamfer("run", "trials", "interrupted", "--out", out)
    assert (status, err) == (130, INTERRUPTED)
    names = ("result.json", "scenario.yaml", "traces.parquet")
    assert files(out) == ["index.html", *(f"trials/{name}" for name in names)]
    assert 'id="trials"' in (out / "index.html").read_text()


@pytest.mark.parametrize("cause", ["KeyboardInterrupt", "ValueError"])
def test_an_interrupt_of_compiled_code_is_one_too(
    chamfer: Chamfer, falling: Path, out: Path, cause: str
) -> None:
    raised = f"raise SystemError('returned a result with an exception set') from {cause}()"
    falling.write_text(falling.read_text().replace("raise KeyboardInterrupt", raised))
    if cause == "KeyboardInterrupt":
        assert chamfer("run", "interrupted", "--out", out) == (130, "", INTERRUPTED)
    else:
        with pytest.raises(SystemError, match="exception set"):
            chamfer("run", "interrupted", "--out", out)


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_reproduce_goes_on_after_an_error_and_reports_it(
    chamfer: Chamfer, falling: Path, out: Path, workers: str
) -> None:
    text = falling.read_text().replace("raise KeyboardInterrupt", "1 / 0")
    falling.write_text(text.replace("time.sleep(30)", "raise SystemExit"))
    status, said, err = chamfer("reproduce", "--workers", workers, "--out", out)
    assert status == 1
    assert said.splitlines()[-6:] == [
        "3 published values: 1 holds, 1 does not hold, 1 not reached; 1 of 1 specification kept",
        "ended with an error: interrupted: ZeroDivisionError: division by zero",
        "ended with an error: broken: ZeroDivisionError: by zero",
        "ended with an error: asserting: stopped by Drake: Failure at plant.cc:1 in f(): "
        "condition 'x > 0' failed.",
        "ended with an error: slow: stopped by Drake:",
        f"report: {out}/index.html",
    ]
    assert err.count("Traceback") == 2  # of the bugs
    assert "chamfer: broken: ZeroDivisionError: by zero\n" in err
    assert {path.name for path in out.iterdir()} == {"fall", "index.html", "results.md", "trials"}
    table = (out / "results.md").read_text(encoding="utf-8")
    assert "- broken: ZeroDivisionError: by zero\n- asserting: stopped by Drake" in table
