"""Makes docs/insertion-3d.png: the two arms and the peg in its hole, from the insertion's replay.

    .venv/bin/python -m docs._ext.stills [OUT]

OUT (``out``) holds the result of ``chamfer run insertion``. Chromium draws the replay without a
window and without a graphics card.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

from docs._ext.pictures import COMMANDS, DOCS, STILLS
from PIL import Image, ImageDraw
from PIL.PngImagePlugin import PngInfo

from chamfer.analysis.report.results import REPLAY, RESULT, read_result

TIME: Final = 5.45  # s, the peg is halfway in
SIZE: Final = (1472, 640)  # px, twice the width of a page
_BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS: Final = (
    *("--headless", "--no-sandbox", "--hide-scrollbars", "--virtual-time-budget=4000"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
_FRAME: Final = "#d9480f"  # around the peg in the cell, and around its close-up
_MARK: Final = (430, 311, 522, 359)  # px, the peg and its hole in the view of the cell


class View(NamedTuple):
    """A camera of the replay, and the part of the picture that it fills."""

    eye: tuple[float, float, float]  # m, in the world frame
    target: tuple[float, float, float]  # m
    angle: float  # deg, from the bottom of the picture to its top
    left: int  # px
    right: int  # px


CELL: Final = View(eye=(-0.3, -1.8, 0.6), target=(-0.05, 0, 0.19), angle=38.5, left=0, right=920)
PEG: Final = View(eye=(-0.1, -0.22, 0.26), target=(0, 0, 0.163), angle=26, left=920, right=1472)


def script(view: View, time: float) -> str:
    """Return the script that shows a replay at a time, s, as a view sees it."""
    eye, target = ([one[0], one[2], -one[1]] for one in (view.eye, view.target))
    return f"""<script>setTimeout(() => {{
      document.querySelectorAll('.lil-gui, .dg').forEach(e => e.style.display = 'none');
      viewer.animator.pause();
      viewer.animator.seek({time});
      viewer.set_property(['Cameras', 'default', 'rotated', '<object>'], 'position', {eye});
      viewer.set_camera_target({target});
      viewer.camera.fov = {view.angle};
      viewer.camera.updateProjectionMatrix();
      viewer.controls.update();
      viewer.render();
    }}, 1500)</script>"""


def drawn(page: str, view: View) -> Image.Image:
    """Return what a replay's page shows, drawn at twice its size for smooth edges."""
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is None:
        raise SystemExit(f"stills: none of {', '.join(_BROWSERS)} is installed")
    size = view.right - view.left, SIZE[1]
    with tempfile.TemporaryDirectory() as folder:
        file, picture = Path(folder, "view.html"), Path(folder, "view.png")
        file.write_text(page.replace("</body>", f"{script(view, TIME)}</body>"), encoding="utf-8")
        window = f"--window-size={2 * size[0]},{2 * size[1]}"
        command = [browser, *_OPTIONS, window, f"--screenshot={picture}", file.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        with Image.open(picture) as found:
            return found.convert("RGB").resize(size, Image.Resampling.LANCZOS)


def main(out: Path) -> None:
    """Write the still, with the scenario that it was made from."""
    ((name, experiment),) = STILLS.items()
    folder = out / experiment
    if not (folder / REPLAY).exists():
        raise SystemExit(f"stills: no {REPLAY} in {folder}, run chamfer run {experiment} first")
    page = (folder / REPLAY).read_text(encoding="utf-8")
    result = read_result(folder / RESULT)
    picture = Image.new("RGB", SIZE, "white")
    for view in (CELL, PEG):
        picture.paste(drawn(page, view), (view.left, 0))
    draw = ImageDraw.Draw(picture)
    for box in (_MARK, (PEG.left, 0, PEG.right - 1, SIZE[1] - 1)):
        draw.rectangle(box, outline=_FRAME, width=3)
    about = PngInfo()
    about.add_text("experiment", experiment)
    about.add_text("scenario_sha256", result["scenario_sha256"])
    about.add_text("command", COMMANDS[f"docs/{name}"])
    picture.save(DOCS / name, optimize=True, pnginfo=about)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
