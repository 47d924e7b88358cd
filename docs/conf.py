"""Sphinx configuration of the documentation site, which `make site` builds; tutorials are executed as it is built."""

import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "site_extension"), str(HERE.parent / "studies")]

import ziamath  # noqa: E402

from tenodesis import __version__  # noqa: E402

project = "Tenodesis"
author = "The Tenodesis authors"
release = __version__
copyright = author

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "generated",
    "mathml",
    "repository",
    "shell_cells",
    "signatures",
]
exclude_patterns = ["console/*", "site_extension"]
suppress_warnings = ["myst-nb.lexer"]  # of a build that executes nothing

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4

# What a cell runs is what stands beside this Python, in a folder of its own, on a page of fixed width, without colours.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
_profile = Path(tempfile.mkdtemp(prefix="tenodesis-docs-"), "profile_default")
_profile.mkdir()
_profile.joinpath("ipython_kernel_config.py").write_text(
    f"c.InteractiveShellApp.exec_files = [{str(HERE / 'site_extension/kernel.py')!r}]\n"
    "c.InlineBackend.figure_formats = ['svg']\n"
    "c.InlineBackend.rc = {'figure.figsize': (7, 3.2), 'font.size': 10, 'axes.grid': True, 'grid.alpha': 0.3}\n",
    "utf-8",
)
os.environ.update(COLUMNS="88", IPYTHONDIR=str(_profile.parent), PYTHONWARNINGS="ignore")

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # signatures are shown as the source has them
maximum_signature_line_length = 90
python_use_unqualified_type_names = True
napoleon_google_docstring = False
add_module_names = False

html_theme = "furo"
html_title = "Tenodesis"
html_static_path = ["_static", str(Path(ziamath.__file__).parent / "fonts")]  # the font of equations
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_math_renderer = "mathml"
copybutton_selector = "div.cell_input pre, div.highlight-sh pre, div.highlight-python pre, div.highlight-toml pre"
