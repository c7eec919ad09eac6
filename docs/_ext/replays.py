"""Stores 3-D replays in a fortieth of their size, and makes pages of them again.

A replay's page holds Meshcat's script, which the site has once, and what the script is to show, as
MessagePack. Of that the numbers of an animation keep seven digits.
"""

import base64
import json
import lzma
import re
from pathlib import Path
from typing import Final

import pydrake

SCRIPT: Final = Path(pydrake.__file__).parent / "share/drake/geometry/meshcat.js"
_LINK: Final = f'<script src="{SCRIPT.name}"></script>'
_INLINE: Final = re.compile(r'<script type="text/javascript">.*?</script>', re.DOTALL)
_SHOWN: Final = re.compile(
    r'fetch\("data:application/octet-binary;base64,([^"]*)"\)\s*\.then\([^\n]*\n\s*\.then\([^\n]*\n'
)
_PLACE: Final = "/* shown */"
_SHOW: Final = """const shown = Uint8Array.from(atob("%s"), (one) => one.charCodeAt(0));
let start = 0;
for (const size of %s) viewer.handle_command_bytearray(shown.slice(start, (start += size)));
"""
# Doubles; other numbers of several bytes are matched so that no byte of theirs begins one.
_NUMBER: Final = re.compile(rb"[\xcd\xdc]..|\xcc.|\xcb(....)....", re.DOTALL)


def packed(page: str) -> bytes:
    """Return a replay's page, as Meshcat writes it, without the script and compressed."""
    messages = [_rounded(base64.b64decode(one)) for one in _SHOWN.findall(page)]
    rest = _SHOWN.sub("", _SHOWN.sub(_PLACE, _INLINE.sub(_LINK, page, count=1), count=1))
    head = json.dumps({"page": rest, "sizes": [len(one) for one in messages]})
    return lzma.compress(b"\n".join([head.encode(), b"".join(messages)]))


def unpacked(stored: bytes) -> str:
    """Return the page of a stored replay, which needs the script beside it."""
    head, _, shown = lzma.decompress(stored).partition(b"\n")
    about = json.loads(head)
    show = _SHOW % (base64.b64encode(shown).decode(), about["sizes"])
    return str(about["page"]).replace(_PLACE, show)


def _rounded(message: bytes) -> bytes:
    """Return a message; of the numbers of an animation the last bytes are 0, which compresses."""
    if b"set_animation" not in message[:40]:
        return message
    return _NUMBER.sub(
        lambda one: one[0] if one[1] is None else b"\xcb" + one[1] + bytes(4), message
    )
