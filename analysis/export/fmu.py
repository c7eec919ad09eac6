"""Laws as units for co-simulation, FMI 2.0: sources, and a binary if a compiler is available.

Modelica Association, Functional Mock-up Interface 2.0.4. The unit holds no Python. Its bytes
follow from the law and the compiler alone.
"""

import hashlib
import io
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from chamfer.analysis.export.c_code import LawInC
from chamfer.analysis.scenario.errors import ExperimentError

_STRICT: Final = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-pedantic")
_LIBRARY: Final = ("-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden", "-shared", "-s")
_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)  # when every file in a unit is from
_MOST: Final = 60.0  # s, that a compiler may take


def compiler() -> str | None:
    """Return the C compiler, None if there is none or it does not build for Linux on x86-64."""
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        return None
    return next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)


def fmu(law: LawInC, experiment: str, *, tool: str, compiler: str | None) -> bytes:
    """Return the unit of a law, with a library for Linux on x86-64 if there is a compiler.

    Raises:
        ExperimentError: If the compiler fails.
    """
    identifier = re.sub("^(?=[0-9])", "_", f"{experiment}_{law.name}".replace("-", "_"))
    elements = list(law.elements)
    inputs = [one for one in elements if one.causality == "input"]

    def described(guid: str) -> dict[str, str]:
        values = {"identifier": identifier, "tool": tool, "elements": elements, "inputs": inputs}
        of_unit = {
            "modelDescription.xml": "model_description.xml.jinja",
            "sources/fmu.c": "fmu.c.jinja",
        }
        return {
            **{
                name: law.render(template, guid=guid, **values)
                for name, template in of_unit.items()
            },
            **{f"sources/{name}": text for name, text in law.files().items()},
        }

    digest = hashlib.sha256("".join(described("").values()).encode()).hexdigest()
    texts = described(str(uuid.UUID(digest[:32])))
    files = {name: text.encode() for name, text in texts.items()}
    if compiler is not None:
        files[f"binaries/linux64/{identifier}.so"] = _library(compiler, texts)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _library(compiler: str, texts: Mapping[str, str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="chamfer-") as folder:
        sources = [name.partition("/")[2] for name in texts if name.startswith("sources/")]
        for name in sources:
            Path(folder, name).write_text(texts[f"sources/{name}"], encoding="utf-8")
        compiled = [name for name in sources if name.endswith(".c")]
        command = [compiler, *_STRICT, *_LIBRARY, *compiled, "-o", "unit.so", "-lm"]
        try:
            subprocess.run(
                command, cwd=folder, check=True, capture_output=True, text=True, timeout=_MOST
            )
        except (OSError, subprocess.SubprocessError) as error:
            said = str(getattr(error, "stderr", None) or error).strip().splitlines()[0]
            raise ExperimentError(f"{compiler} can't compile the unit: {said}") from error
        return Path(folder, "unit.so").read_bytes()
