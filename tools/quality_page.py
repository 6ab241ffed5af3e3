"""The page of the quality codes, from the links themselves."""

from __future__ import annotations

from fieldlink.links.base import Quality
from tools.tables import markdown_table

__all__ = ["quality_page"]

_HEAD = """# Quality codes

The column `quality` of stored samples (`fieldlink export`, the historian's table `samples`) and the
key `quality` of samples over MQTT hold the code of the worst signal; `fieldlink read --json` has
the name. What has another code than 0 is a missing sample.
"""


def quality_page() -> str:
    """Return the page in Markdown."""
    rows = [
        (f"{one.code}", f"`{one.name.lower()}`", one.advice)
        for one in sorted(Quality, key=lambda one: one.code)
    ]
    return f"{_HEAD}\n{markdown_table(('code', 'name', 'meaning'), rows)}"
