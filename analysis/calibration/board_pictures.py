"""Pictures of a board on disk, and the board's corners in them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np

from chamfer.analysis.calibration.board import Board, Grey, NotFoundError
from chamfer.analysis.calibration.camera_fit import Seen
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Progress
from chamfer.analysis.track.recorded_frames import Recording, open_recording, shown_name

Size = tuple[int, int]  # pixels, width and height


@dataclass(frozen=True, kw_only=True)
class BoardPictures:
    """What was seen of a board in the pictures of a camera."""

    seen: tuple[Seen, ...]
    size: Size  # of most pictures; (0, 0) if none can be read
    contents: Mapping[bytes, str]  # names of the pictures by what is in them


def picture_files(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the image files, or those of an image folder, in natural order.

    Raises:
        UserError: If there are none.
    """
    recording = open_recording(paths)
    if recording.video:
        raise UserError(f"{recording.files[0]} is a video, allowed: an image folder, image files")
    return recording.files


def see_board(
    board: Board, files: Sequence[Path], *, others: Mapping[bytes, str], progress: Progress
) -> BoardPictures:
    """Look for a board in pictures.

    Args:
        board: The board.
        files: The pictures.
        others: Pictures that are not to be used once more.
        progress: Told after every picture.
    """
    seen: list[Seen] = []
    sizes: list[Size | None] = []
    contents: dict[bytes, str] = {}
    for k, file in enumerate(files):
        name = shown_name(file)
        try:
            image = _grey(file)
        except UserError as error:
            reason = str(error).removeprefix(f"{file}").removeprefix(name).lstrip(": ")
            seen.append(Seen(name=name, reason=reason))
            sizes.append(None)
        else:
            key = sha256(repr(image.shape).encode() + image.tobytes()).digest()
            same = contents.get(key, others.get(key))
            contents.setdefault(key, name)
            seen.append(_look(board, image, name, same))
            sizes.append((image.shape[1], image.shape[0]))
        progress((k + 1) / len(files), f"picture {k + 1}")
    known = [size for size in sizes if size is not None]
    size = Counter(known).most_common(1)[0][0] if known else (0, 0)
    return BoardPictures(
        seen=tuple(_of_size(one, own, size) for one, own in zip(seen, sizes, strict=True)),
        size=size,
        contents=contents,
    )


def _look(board: Board, image: Grey, name: str, same: str | None) -> Seen:
    if same is not None:
        return Seen(name=name, reason=f"the same picture as {same}")
    try:
        return Seen(name=name, corners=board.find(image))
    except NotFoundError as error:
        return Seen(name=name, reason=str(error))


def _of_size(one: Seen, own: Size | None, size: Size) -> Seen:
    if own is None or own == size:
        return one
    reason = "it is {} x {} pixels, most are {} x {}".format(*own, *size)
    return replace(one, corners=None, reason=reason)


def _grey(file: Path) -> Grey:
    (frame,) = Recording(files=(file,), video=False).frames()
    return cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
