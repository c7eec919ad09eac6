"""Hides what every executed page repeats, and links each figure to its full size."""

import ast
import re
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx

_BASH = "%%bash\n"


def setup(app: Sphinx) -> dict[str, bool]:
    """Edit pages once they are read, and their pictures once they are chosen."""
    app.connect("doctree-read", lambda _, page: hide_boilerplate(page))
    app.connect("doctree-read", lambda _, page: break_names(page))
    app.connect("doctree-resolved", lambda app, page, _: link_figures(page, Path(app.srcdir)))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def hide_boilerplate(page: nodes.document) -> None:
    """Drop inputs that only show a picture; drop the line that hands an input to the shell."""
    for block in list(page.findall(nodes.literal_block)):
        code = block.astext()
        if code.startswith(_BASH):
            code = code.removeprefix(_BASH)
            block.replace_self(nodes.literal_block(code, code, language="bash"))
        elif "cell_input" in block.parent.get("classes", ()) and only_shows_a_picture(code):
            block.parent.parent.remove(block.parent)


def only_shows_a_picture(code: str) -> bool:
    """Return whether an input does no more than ``SVG(filename=...)`` and its import."""
    try:
        lines = ast.parse(code).body
    except SyntaxError:
        return False
    return bool(lines) and all(
        ast.unparse(line).startswith(("SVG(", "from IPython.display import SVG")) for line in lines
    )


def break_names(page: nodes.document) -> None:
    """Let long dotted names in tables break at their dots and underscores."""
    for cell in page.findall(nodes.entry):
        for name in cell.findall(nodes.literal):
            parts = re.split(r"(?<=[._/])(?=\w)", name.astext())
            name.clear()
            for part in parts:
                name += [nodes.Text(part), nodes.raw("", "<wbr>", format="html")]


def link_figures(page: nodes.document, folder: Path) -> None:
    """Link every figure to its full size, and tell drawings from photographs for dark pages."""
    for image in page.findall(nodes.image):
        if not isinstance(image.parent, nodes.reference):
            image["width"] = "100%"  # Sphinx links what has a size; pages.css sets the true one
            image["classes"].append("full")
        if "drawn" in image["classes"]:  # a drawing as pixels, by its page
            continue
        path = folder / image["uri"]
        drawn = path.suffix == ".svg" and b"<image" not in path.read_bytes()
        image["classes"].append("drawn" if drawn else "photo")
