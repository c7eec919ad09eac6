from chamfer.analysis.report.console import result_text


def test_what_an_experiment_comes_to_is_said_last_and_once() -> None:
    note = "Of all that was tried nothing matters. " * 5
    result = {
        "experiment": "study",
        "figure": "",
        "wall_seconds": 1.0,
        "checks": [],
        "overrides": [],
        "metrics": {
            "answer": {"value": 0.0, "unit": "", "note": note},
            "error": {"value": 2.0, "unit": "m"},
        },
    }
    text = result_text(result)
    table, _, said = text.partition("\n\n")
    assert "answer" not in table
    assert table.splitlines()[-1].split() == ["error", "2", "m"]
    assert " ".join(said.split()) == note.strip()
    assert max(map(len, said.splitlines())) <= 92
