"""Sphinx configuration: Markdown pages by MyST, the API from docstrings, furo as the theme."""

import sys
from pathlib import Path

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import generate  # noqa: E402  (found only once the folder is on the path)

logger = logging.getLogger(__name__)

project = "geoskill"
author = "The geoskill developers"
project_copyright = author

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_generated/configuration.md"]  # included by usage/configuration.md
html_theme = "furo"
html_title = "geoskill"
html_show_sphinx = False

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_use_ivar = True
napoleon_use_rtype = False
maximum_signature_line_length = 100


def _write_math(self: HTML5Translator, node: nodes.Element, as_block: bool) -> None:
    try:
        markup = latex2mathml.tex2mathml(node.astext(), as_block=as_block)
    except MathError as error:
        logger.warning("equation: %s", error, location=node)
        markup = ""
    self.body.append(f'<div class="math">{markup}</div>' if as_block else markup)
    raise nodes.SkipNode


def _visit_math(self: HTML5Translator, node: nodes.math) -> None:
    _write_math(self, node, as_block=False)


def _visit_math_block(self: HTML5Translator, node: nodes.math_block) -> None:
    _write_math(self, node, as_block=True)


def setup(app: Sphinx) -> None:
    """Generate pages before Sphinx looks for them; write equations as MathML, which needs no script from a network."""
    generate.main()
    app.add_html_math_renderer("mathml", (_visit_math, None), (_visit_math_block, None))
    app.config.html_math_renderer = "mathml"
