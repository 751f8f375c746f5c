"""The documentation's site, built by Sphinx: `pip install '.[docs]'`, then `sphinx-build -W docs site`.

The pages are those that `swarm docs` prints; the page of the commands is made of their own help.
"""

import os
from pathlib import Path
from typing import Any

from swarm.version import VERSION

project = "lighthouse-swarm"
author = "The lighthouse-swarm authors"
release = VERSION
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["gallery/gallery.json"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
highlight_language = "none"
html_theme = "furo"
html_title = f"{project} {release}"
html_show_copyright = False
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
nitpicky = False
COMMANDS = "commands.rst"
"""The page that is made of the commands' help."""


def _write_commands(app: Any) -> None:
    from typer.main import get_command
    from typer.testing import CliRunner

    from swarm.cli.app import app as swarm

    os.environ["COLUMNS"] = "96"
    runner, lines = CliRunner(), ["Commands", "========", "", "What ``swarm COMMAND --help`` prints.", ""]
    for name in get_command(swarm).commands:  # type: ignore[attr-defined]
        text = runner.invoke(swarm, [name, "--help"], prog_name="swarm").output
        title = f"swarm {name}"
        lines += [title, "-" * len(title), "", ".. code-block:: text", ""]
        lines += [f"   {line}".rstrip() for line in text.splitlines()] + [""]
    Path(app.srcdir, COMMANDS).write_text("\n".join(lines), encoding="utf-8")


def setup(app: Any) -> None:
    """Make the page of the commands before the others are read."""
    app.connect("builder-inited", _write_commands)
