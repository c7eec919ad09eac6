"""What the site keeps of results: no picture is stale, and replays show what they showed."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import pytest
from docs._ext import gallery, pictures, result_pages
from docs._ext.gallery import STORED_REPLAY, keep
from docs._ext.pictures import GALLERY
from docs._ext.replays import packed, unpacked
from PIL import Image

MOST = 8_000_000  # bytes of all that is kept


def test_a_command_is_known_for_every_picture() -> None:
    assert pictures.unlisted() == []


def test_no_picture_is_stale() -> None:
    assert list(pictures.stale()) == []


def test_every_experiment_is_kept_and_all_are_small() -> None:
    assert pictures.missing() == []
    assert sum(path.stat().st_size for path in GALLERY.rglob("*") if path.is_file()) < MOST


def test_a_wrong_copy_is_found(kept: Path) -> None:
    assert list(pictures.stale()) == []
    (kept / "step.webp").rename(kept / "other.webp")
    result = json.loads((kept / "result.json").read_text("utf-8"))
    (kept / "result.json").write_text(json.dumps(result | {"scenario_sha256": "0"}), "utf-8")
    (kept.parent / "no-experiment").mkdir()
    unknown, scenario, files = pictures.stale()
    assert "no-experiment: no such experiment" in unknown
    assert "another default scenario: chamfer run step-response" in scenario
    assert "other.webp, step.webp" in files


def test_a_result_becomes_a_figure_and_a_table(kept: Path) -> None:
    result: dict[str, Any] = json.loads((kept / "result.json").read_text("utf-8"))
    assert result["figures"] == [
        {"file": "step.webp", "caption": "FSM is slower. So it is.", "drawn": True}
    ]
    (drawn,) = result_pages.figures("step-response", result)
    assert "   :alt: step: FSM is slower.\n" in drawn
    assert drawn.endswith("\n   FSM is slower. So it is.\n")
    rows = result_pages.checks(result["checks"], notes=True)
    assert (
        "- 10.5 ± 0.05 %\n     - 11 %\n     - **not reached**\n     - *calibrated:* Fig. 8" in rows
    )


def test_a_stored_replay_shows_the_same() -> None:
    pose = b"\x82\xa4time\xcc\xcb\xa5value\xcb" + bytes.fromhex("3fd5555555555555")
    messages = [b"\x81\xa4type\xaaset_object" + bytes(range(256)), b"set_animation" + pose]
    fetched = "".join(
        f'fetch("data:application/octet-binary;base64,{base64.b64encode(one).decode()}")\n'
        "    .then(res => res.arrayBuffer())\n    .then(buffer => viewer.handle(buffer));\n"
        for one in messages
    )
    page = f'<p/><script type="text/javascript">var long;</script><script>{fetched}</script>'
    shown = unpacked(packed(page))
    assert "var long" not in shown
    assert '<script src="meshcat.js"></script>' in shown
    (data,) = re.findall(r'atob\("(.*?)"\)', shown)
    (sizes,) = re.findall(r"of (\[.*?\])", shown)
    assert json.loads(sizes) == [len(one) for one in messages]
    rounded = messages[1][:-8] + bytes.fromhex("3fd5555500000000")
    assert base64.b64decode(data) == messages[0] + rounded


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the copy of a small result, alone in its gallery."""
    folder = tmp_path / "out" / "step-response"
    folder.mkdir(parents=True)
    for module in (gallery, pictures):
        monkeypatch.setattr(module, "GALLERY", tmp_path / "gallery")
    monkeypatch.setattr(pictures, "hashes", lambda: {"step-response": "1", "insertion": "2"})
    monkeypatch.setattr(pictures, "STILLS", {})
    Image.new("RGB", (2000, 1000), "white").save(folder / "step.png")
    (folder / "step.svg").write_text("<svg/>", "utf-8")
    check = {"metric": "pid.overshoot", "relation": "near", "published": 10.5, "tolerance": 0.05}
    check |= {"measured": 11.0, "unit": "%", "kind": "calibrated", "source": "Fig. 8", "note": ""}
    about = dict.fromkeys(gallery._KEPT, "") | {"experiment": "step-response"}
    about |= {"scenario_sha256": "1", "checks": [check | {"verdict": "not_reached", "ok": False}]}
    about |= {"figures": ["step.svg", "step.png"]}
    about["captions"] = {"step.svg": "FSM is slower. So it is."}
    (folder / "result.json").write_text(json.dumps(about), "utf-8")
    keep(folder)
    assert not (tmp_path / "gallery" / "step-response" / STORED_REPLAY).exists()
    return tmp_path / "gallery" / "step-response"
