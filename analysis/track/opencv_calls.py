"""What OpenCV needs around its calls: silence, and names of files that it can take."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def silenced() -> Iterator[None]:
    """Drop what the block writes to the process's standard error.

    Decoders and encoders write there what went wrong; whoever calls them says it in one line.
    """
    sys.stderr.flush()
    before = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


@contextmanager
def utf8_path(path: Path) -> Iterator[str]:
    """Give a name by which OpenCV can open a file or make it; another one is a crash.

    It is absolute, as a name with a colon would be taken for an address.
    """
    name = str(path.absolute())
    try:
        name.encode()
    except UnicodeEncodeError:
        with tempfile.TemporaryDirectory() as folder:
            link = Path(folder, f"link{path.suffix if path.suffix.isascii() else ''}")
            link.symlink_to(name)
            yield str(link)
    else:
        yield name
