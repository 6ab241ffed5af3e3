"""How `make docs` builds the site, which works from a folder and loads nothing from a network."""

import re
from importlib.metadata import version as version_of
from pathlib import Path

from sphinx.application import Sphinx

project = "fieldlink"
copyright = "the fieldlink authors, Apache License 2.0"
release = version_of("fieldlink")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"fieldlink {release}"
html_copy_source = False

# Links such as page.md#heading are checked against the headings themselves.
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_class_signature = "mixed"
napoleon_use_ivar = True
napoleon_use_rtype = False
# Code in backticks is code, as in the docstrings.
default_role = "code"

FROM_THE_TOP = {
    "index": "README.md",
    "contributing": "CONTRIBUTING.md",
    "changelog": "CHANGELOG.md",
    "examples": "examples/README.md",
    "reporting-security": "SECURITY.md",
}
"""By page, the file outside `docs` whose text it holds."""


def _link_from_docs(found: re.Match[str]) -> str:
    """Turn a link that is right at the top of the repository into one that is right in docs."""
    target = found[1]
    for page, name in FROM_THE_TOP.items():
        if target == name:
            return f"]({page}.md)"
    inside = target.removeprefix("docs/")
    return f"]({inside})" if inside != target else f"](../{target})"


def _read_from_the_top(app: Sphinx, page: str, source: list[str]) -> None:
    name = FROM_THE_TOP.get(page)
    if name is not None:
        path = Path(app.srcdir).parent / name
        app.env.note_dependency(str(path))
        text = path.read_text(encoding="utf-8")
        text = re.sub(r"\]\((?!https?:|#)([^)]+)\)", _link_from_docs, text)
        source[0] = f"{text}\n\n{source[0]}"


def _mark_code(*event: object) -> None:
    """Make code of a docstring's indented lines, and one field of names that share a sentence."""
    lines = event[-1]
    assert isinstance(lines, list)
    marked: list[str] = []
    last = ""
    for line in lines:
        begins = line.startswith("    ") and not (marked and marked[-1].strip())
        if begins and last and not last.startswith(" ") and not last.endswith(("::", ":")):
            marked += ["::", ""]
        marked.append(re.sub(r"^( {4}\w+(?:, \w+)+): ", lambda m: m[0].replace(", ", ","), line))
        last = line if line.strip() else last
    lines[:] = marked


def setup(app: Sphinx) -> None:
    """Let pages hold the files at the top of the repository."""
    app.connect("source-read", _read_from_the_top)
    # Before napoleon reads the sections.
    app.connect("autodoc-process-docstring", _mark_code, priority=400)
