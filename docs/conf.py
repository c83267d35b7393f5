"""Settings of Sphinx. `make docs` builds the site; nothing on a page is loaded from the network."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

from generators.results.measured import substitutions  # noqa: E402

project = "robosim"
author = "the robosim authors"
copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton", "sphinx_design", "generators.mathml",
              "generators.docstrings", "generators.pages"]
exclude_patterns = ["_build", "_generated"]
suppress_warnings = ["myst.header"]

myst_enable_extensions = ["amsmath", "attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath",
                          "substitution"]
myst_heading_anchors = 3
myst_substitutions = substitutions()

html_theme = "furo"
html_title = "robosim"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
templates_path = []
smartquotes = False  # they would turn --out into a dash

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
toc_object_entries = False
default_role = "code"
copybutton_prompt_text = r"\$ "
copybutton_prompt_is_regexp = True
