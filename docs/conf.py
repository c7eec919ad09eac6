"""Sphinx configuration of the documentation: `make docs` builds it into out/docs."""

import os
import sys
from pathlib import Path

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from nbclient import NotebookClient
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

ROOT = Path(__file__).parent.parent
# The pages run the code of this tree and the `chamfer` of this interpreter.
sys.path[:0] = [str(ROOT / "src"), str(ROOT)]
os.environ["PYTHONPATH"] = f"{ROOT / 'src'}{os.pathsep}{ROOT}"
os.environ["PATH"] = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))

project = "Chamfer"
author = "the authors of Chamfer"
project_copyright = "the authors of Chamfer, BSD-3-Clause"
extensions = ["myst_nb", "docs._ext.reference_pages", "docs._ext.page_shell"]
exclude_patterns = ["reference/generated/_*"]
nitpicky = True

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 120  # s, of one cell
nb_execution_show_tb = True  # the reason of a failed cell goes to the log
# A command prints in pieces of any length; MyST-NB would end each one with a new line.
NotebookClient.coalesce_streams = True
nb_output_stderr = "remove"  # the progress of commands

html_theme = "furo"
html_title = "Chamfer"
html_theme_options = {
    "top_of_page_buttons": [],
    "light_css_variables": {"code-font-size": "75%"},  # 99 columns fit
    "dark_css_variables": {"code-font-size": "75%"},
}
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False
html_math_renderer = "mathml"


def visit_math(translator: HTML5Translator, node: nodes.math) -> None:
    """Write an inline formula as MathML, which browsers set without a network."""
    translator.body.append(tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def visit_displaymath(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula of its own line as MathML."""
    translator.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the renderer of formulas."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_displaymath, None))
