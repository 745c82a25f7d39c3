"""Sphinx: `make docs` builds the site into build/docs. Warnings are errors."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # agents, train and eval are not installed

import visenvs  # noqa: E402

project = "visenvs"
author = "visenvs contributors"
copyright = "visenvs contributors"
version = release = visenvs.__version__

extensions = ["myst_nb", "pages"]
exclude_patterns = ["README.md"]
html_theme = "furo"
html_title = "visenvs"
html_theme_options = {"navigation_with_keys": True}

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["misc.highlighting_failure"]

nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "notebooks")
nb_execution_timeout = 1200  # of a cell; kernels compile in the first build
nb_execution_raise_on_error = True
nb_merge_streams = True
