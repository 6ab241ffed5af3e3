"""A report on paper: A4 across, the list first, then a page of evidence for each loop with work."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from fieldlink.worklist import texts
from fieldlink.worklist.audience import Column, needs_picture
from fieldlink.worklist.document import WorkDocument
from fieldlink.worklist.errors import ReportError
from fieldlink.worklist.evidence_figure import draw_pngs
from fieldlink.worklist.finding import Wrong
from fieldlink.worklist.from_store import ReportedLoop
from fieldlink.worklist.row import BeforeAfter

if TYPE_CHECKING:
    from fpdf import FPDF

__all__ = ["render_pdf"]

_FONT = "DejaVu"
_INK, _SOFT, _ACCENT, _LINE = (29, 39, 51), (82, 96, 109), (31, 78, 121), (211, 218, 225)
_COLOUR = {
    Wrong.STICKY_VALVE: (163, 39, 27),
    Wrong.SENSOR: (163, 39, 27),
    Wrong.UNDETERMINED: (138, 90, 0),
    Wrong.UNREADABLE: (138, 90, 0),
    Wrong.QUIET: (30, 107, 40),
}
_MARGIN = 12.0
"""Millimetres at every side."""
_LETTERS = (
    "[U+...]: number of a letter (Unicode) that the fonts of this file lack; the HTML report shows "
    "it."
)


def render_pdf(document: WorkDocument) -> bytes:
    """Return the report as PDF.

    Raises:
        ReportError: fpdf2 is not installed.
    """
    paper = _new_paper(document)
    paper.add_page()
    _print_heading(paper, document)
    if document.listed:
        _print_list(paper, document)
    else:
        _print_text(paper, "No loop has work.")
    if document.audience.shows_repairs:
        for loop in document.repaired:
            assert loop.row.repair is not None
            _print_title(paper, f"Repair of {loop.row.tag}", _ACCENT)
            _print_repair(paper, loop.row.repair)
    ranks = {loop.row.tag: rank for rank, loop in enumerate(document.loops, 1)}
    shown = [loop for loop in document.evidenced if needs_picture(loop)]
    for loop, picture in zip(shown, draw_pngs(shown), strict=True):
        paper.add_page()
        _print_evidence(paper, loop, ranks[loop.row.tag], picture)
    return bytes(paper.output())


def _new_paper(document: WorkDocument) -> FPDF:
    try:
        from fpdf import FPDF
    except ImportError as error:
        raise ReportError(
            "PDF needs fpdf2; pip install 'fieldlink[plot]', or write an .html and print it"
        ) from error
    from fieldlink.known_letters import FONT_FILES, with_known_letters

    class Paper(FPDF):
        """Pages with a number and the report's title at the foot."""

        def normalize_text(self, text: str) -> str:
            return with_known_letters(super().normalize_text(text))

        def footer(self) -> None:
            self.set_y(-9.0)
            self.set_font(_FONT, size=7)
            self.set_text_color(*_SOFT)
            self.cell(0, 4, f"{document.title}; page {self.page_no()} of {{nb}}", align="R")

    paper = Paper(orientation="landscape", format="A4")
    for style, file in zip(("", "B"), FONT_FILES, strict=True):
        paper.add_font(_FONT, style, file)
    paper.set_margins(_MARGIN, _MARGIN)
    paper.set_auto_page_break(True, margin=_MARGIN)
    paper.set_title(document.title)
    paper.set_creation_date(document.made)
    paper.set_lang("en")
    return paper


def _print_heading(paper: FPDF, document: WorkDocument) -> None:
    _print_title(paper, document.title, _INK, size=16)
    _print_text(paper, f"{document.subtitle}. {document.audience.question}", _SOFT, size=8)
    paper.ln(1.5)
    _print_text(paper, " ".join(document.summary))
    paper.ln(2)


def _print_list(paper: FPDF, document: WorkDocument) -> None:
    from fpdf.fonts import FontFace

    from fieldlink.known_letters import has_known_letters

    columns = (Column("#", lambda _row: "", 1.6, True), *document.audience.columns)
    ranks = {loop.row.tag: rank for rank, loop in enumerate(document.loops, 1)}
    paper.set_font(_FONT, size=6.4 if len(columns) > 12 else 7.5)
    paper.set_text_color(*_INK)
    paper.set_draw_color(*_LINE)
    with paper.table(
        col_widths=tuple(column.width for column in columns),
        text_align=tuple("RIGHT" if column.is_number else "LEFT" for column in columns),
        borders_layout="HORIZONTAL_LINES",
        headings_style=FontFace(emphasis="BOLD", color=_ACCENT),
        line_height=paper.font_size * 1.3,
        padding=(0.7, 0.8),
    ) as table:
        heading = table.row()
        for column in columns:
            heading.cell(column.title)
        for loop in document.listed:
            row = table.row()
            row.cell(str(ranks[loop.row.tag]))
            for column in columns[1:]:
                style = None
                if column.title == "what is wrong":
                    colour = _COLOUR.get(loop.row.finding.wrong, _INK)
                    style = FontFace(emphasis="BOLD", color=colour)
                elif column.title == "loop":
                    style = FontFace(emphasis="BOLD")
                row.cell(column.text(loop.row), style=style)
    paper.ln(1)
    _print_text(paper, document.audience.legend, _SOFT, size=7)
    if not all(has_known_letters(loop.row.tag) for loop in document.listed):
        _print_text(paper, _LETTERS, _SOFT, size=7)


def _print_evidence(paper: FPDF, loop: ReportedLoop, rank: int, picture: bytes) -> None:
    row, finding = loop.row, loop.row.finding
    colour = _COLOUR.get(finding.wrong, _INK)
    _print_title(paper, f"{rank}. {row.tag}: {texts.wrong_text(row)}", colour)
    item = row.item
    owner = f", owner {item.owner}" if item is not None and item.owner else ""
    note = f": {item.note}" if item is not None and item.note else ""
    device = f"device {row.device}; " if row.device else ""
    state = texts.state_text(row).replace("\n", " since ")
    _print_text(paper, f"{device}state {state}{owner}{note}", _SOFT, size=8)
    outage = " (needs an outage)" if finding.action.needs_outage else ""
    _print_text(paper, f"Next: {finding.action_text}{outage}", bold=True, size=9.5)
    paper.ln(1)
    paper.image(io.BytesIO(picture), w=paper.epw)
    paper.ln(2)
    top, page = paper.get_y(), paper.page
    half = 0.5 * paper.epw - 4.0
    paper.set_right_margin(_MARGIN + half + 8.0)
    for title, sentences in _sections(loop):
        _print_text(paper, title, bold=True)
        for sentence in sentences:
            _print_text(paper, f"\N{BULLET} {sentence}", size=8)
        paper.ln(1)
    bottom = paper.get_y()
    paper.set_right_margin(_MARGIN)
    if paper.page == page:
        paper.set_left_margin(_MARGIN + half + 8.0)
        paper.set_y(top)
    facts = [(name, text.replace("\n", ", ")) for name, text in texts.facts_of(row)]
    _print_pairs(paper, facts)
    if row.repair is not None:
        paper.ln(2)
        _print_repair(paper, row.repair)
    paper.set_left_margin(_MARGIN)
    paper.set_y(max(bottom, paper.get_y()))


def _sections(loop: ReportedLoop) -> list[tuple[str, Sequence[str]]]:
    finding = loop.row.finding
    sections: list[tuple[str, Sequence[str]]] = []
    for number, cause in enumerate(finding.causes):
        title = "Why" if number == 0 else f"Also: {cause.wrong.text}"
        weight = "" if cause.weight is None else f" (weight {cause.weight:.2f})"
        sections.append((title + weight, cause.evidence))
    sections.append(("What would determine it", finding.would_determine))
    sections.append(("Remarks", loop.row.remarks))
    return [section for section in sections if section[1]]


def _print_repair(paper: FPDF, repair: BeforeAfter) -> None:
    title = f"repair {texts.day_text(repair.time)}: {repair.source}"
    _print_table(paper, ((title, "before", "after"), *texts.before_after_rows(repair)), (3, 1, 1))


def _print_pairs(paper: FPDF, pairs: Sequence[tuple[str, str]]) -> None:
    """Print names and values, a line under each pair.

    Cells of one line where the text fits, which is nearly always: fpdf2's tables break each text
    into lines twice, which takes longer than everything else on the page.
    """
    paper.set_font(_FONT, size=8)
    paper.set_text_color(*_INK)
    paper.set_draw_color(*_LINE)
    height = paper.font_size * 1.4
    left = 1.2 / 2.2 * paper.epw
    for name, value in pairs:
        if paper.get_string_width(value) > paper.epw - left - 2.0 * paper.c_margin:
            _print_table(paper, [(name, value)], (1.2, 1), heading=False)
            continue
        paper.cell(left, height, name, border="B")
        paper.cell(0, height, value, border="B", align="R", new_x="LMARGIN", new_y="NEXT")


def _print_table(
    paper: FPDF,
    rows: Sequence[tuple[str, ...]],
    widths: tuple[float, ...],
    *,
    heading: bool = True,
) -> None:
    from fpdf.fonts import FontFace

    paper.set_font(_FONT, size=8)
    paper.set_text_color(*_INK)
    paper.set_draw_color(*_LINE)
    options: dict[str, Any] = {"first_row_as_headings": heading}
    if heading:
        options["headings_style"] = FontFace(emphasis="BOLD", color=_ACCENT)
    with paper.table(
        col_widths=widths,
        width=paper.epw,
        align="LEFT",
        text_align=("LEFT", *("RIGHT",) * (len(widths) - 1)),
        borders_layout="HORIZONTAL_LINES",
        line_height=paper.font_size * 1.4,
        **options,
    ) as table:
        for cells in rows:
            table.row(cells)


def _print_title(
    paper: FPDF, text: str, colour: tuple[int, int, int], *, size: float = 13.0
) -> None:
    _print_text(paper, text, colour, size=size, bold=True)


def _print_text(
    paper: FPDF,
    text: str,
    colour: tuple[int, int, int] = _INK,
    *,
    size: float = 9.0,
    bold: bool = False,
) -> None:
    paper.set_font(_FONT, "B" if bold else "", size)
    paper.set_text_color(*colour)
    paper.multi_cell(0, paper.font_size * 1.35, text, new_x="LMARGIN", new_y="NEXT", align="L")
