"""A report as one HTML file that needs no network."""

from __future__ import annotations

import jinja2

from fieldlink.worklist import texts
from fieldlink.worklist.audience import needs_picture
from fieldlink.worklist.document import WorkDocument
from fieldlink.worklist.evidence_figure import draw_svgs

__all__ = ["render_html"]


def render_html(document: WorkDocument) -> bytes:
    """Return the page."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fieldlink.worklist"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    ranks = {loop.row.tag: rank for rank, loop in enumerate(document.loops, 1)}
    numbered = [(ranks[loop.row.tag], loop) for loop in document.evidenced if needs_picture(loop)]
    drawn = zip(numbered, draw_svgs(numbered), strict=True)
    pictures = {loop.row.tag: picture for (_, loop), picture in drawn}
    page = environment.get_template("report.html.j2").render(
        document=document, ranks=ranks, pictures=pictures, texts=texts
    )
    return page.encode("utf-8")
