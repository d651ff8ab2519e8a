"""How Sphinx builds the site: `make docs`. Nothing is loaded from elsewhere when it is read."""

import logging
import sys
from pathlib import Path

from jupyter_client import AsyncKernelManager

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from pricing_core import __version__

project = "pricing-core"
author = copyright = "pricing-core developers"
release = version = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "extension"]
exclude_patterns = ["extension/*"]
html_theme = "furo"
html_title = "pricing-core"
html_show_sphinx = False
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 120
# The kernels that run the pages encrypt their messages: otherwise each warns that it does not. Their start is not told.
AsyncKernelManager.transport_encryption.default_value = "auto"
logging.getLogger("traitlets").setLevel(logging.WARNING)
default_role = "code"  # as docstrings mean it
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings state the types
autodoc_default_options = {"members": True, "imported-members": True}
napoleon_google_docstring = False
napoleon_use_param = False  # or words in types become links to names
napoleon_use_rtype = False
# Docstrings state types in words, some of which are names in several modules; JSON is printed with dots where it goes
# on.
suppress_warnings = ["ref.python", "misc.highlighting_failure"]
