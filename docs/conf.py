"""Sphinx configuration: Markdown pages, theme furo, and equations as MathML so that pages need no network."""

import dataclasses
import inspect
import io
import re
import sys
import tokenize
from importlib.metadata import version as installed
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.domains.python import PyObject

sys.path.insert(0, str(Path(__file__).parent))  # `results_tables`

project = "colift"
author = "the colift developers"
html_show_copyright = False
release = version = installed("colift")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "results_tables"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "cache"  # a notebook is executed when its cells have changed
nb_execution_raise_on_error = True
nb_execution_timeout = 300
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
add_module_names = False  # the heading above states the module
python_use_unqualified_type_names = True
pygments_dark_style = "monokai"
napoleon_google_docstring = True
napoleon_use_ivar = True
napoleon_attr_annotations = False
suppress_warnings = ["ref.python"]  # axis names in shapes, such as `agents`, are not references
default_role = "code"  # as in Markdown, `x` is code

html_theme = "furo"
html_title = "colift"
html_static_path = ["page.css"]
html_css_files = ["page.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
exclude_patterns = ["_build", "jupyter_execute"]


def _inline(self, node):
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _display(self, node):
    self.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>\n')
    raise nodes.SkipNode


def _signature(app, what, name, obj, options, signature, returns):
    """Format signatures with the shapes of the code; fields of types are listed below the docstring."""
    del app, name, options
    if what == "class" and (dataclasses.is_dataclass(obj) or hasattr(obj, "model_fields")):
        return "", None
    return [
        text and re.sub(r"<.*? at 0x\w+>", "...", text.replace("jaxlib._jax.", "")) for text in (signature, returns)
    ]


def _fields(app, what, name, obj, options, lines):
    """Add a table of fields to the docstring of a type: shape, and unit and frame from the comment of the field."""
    del app, name, options
    if what != "class" or not dataclasses.is_dataclass(obj) or not dataclasses.fields(obj):
        return
    comments = _comments(obj)
    described = any(comments.get(field.name) for field in dataclasses.fields(obj))
    lines += ["", ".. list-table::", "   :align: left", ""]
    for field in dataclasses.fields(obj):
        kind = field.type if isinstance(field.type, str) else inspect.formatannotation(field.type)
        lines += [f"   * - ``{field.name}``", f"     - ``{kind}``"]
        lines += [f"     - {comments.get(field.name, '')}"] if described else []
    lines.append("")


def _comments(cls):
    """Return the comment on the line of each field."""
    comments, name = {}, None
    for token in tokenize.generate_tokens(io.StringIO(inspect.getsource(cls)).readline):
        if re.match(r"    (\w+):", token.line):
            name = re.match(r"    (\w+):", token.line)[1]
        if token.type == tokenize.COMMENT and re.match(r"    \w+:", token.line):
            comments[name] = re.sub(r"([*|\\])", r"\\\1", token.string.lstrip("# "))
    return comments


def setup(app):
    """Register the renderer of equations, and the formatters of signatures and fields."""
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-process-docstring", _fields)
    return {"parallel_read_safe": True}
