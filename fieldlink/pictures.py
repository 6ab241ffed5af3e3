"""Pictures of an identification and of a run, with Matplotlib and no display."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.text import Text

from fieldlink.errors import FieldlinkError
from fieldlink.known_letters import with_known_letters
from fieldlink.unfinished_file import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from estimator import Identification

    Array = NDArray[np.float64]

__all__ = [
    "MARK",
    "MODEL",
    "OP",
    "PV",
    "STEM",
    "PictureError",
    "identification_figure",
    "save",
    "svg",
]

OP, STEM, PV, MODEL, MARK = "#7f8c8d", "#c0392b", "#1f4e79", "#e08e0b", "#2e7d32"


SCALE_MARGIN = 0.15
"""Share of the recorded range that PV's scale is wider at each end."""


class PictureError(FieldlinkError):
    """A picture could not be written."""


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of ``path`` names the format.

    Raises:
        PictureError: the ending is unknown, or the file cannot be written.
    """
    if not path.suffix:
        # Matplotlib would write FC101.png for FC101, and nobody would look for it there.
        raise PictureError(f"{path}: the picture has no format; end it in .png, .svg or .pdf")
    picture = io.BytesIO()
    _write_names_as_they_are(figure)
    try:
        figure.savefig(picture, format=path.suffix[1:].lower(), dpi=110)
    except ValueError as error:
        raise PictureError(
            f"{path}: the picture cannot be drawn ({error}); end its name in .png, .svg or .pdf"
        ) from error
    try:
        write_whole(path, picture.getvalue())
    except OSError as error:
        raise PictureError(
            f"{path}: the picture cannot be written ({error.strerror or error}); check the folder "
            "and the free space"
        ) from error


def _write_names_as_they_are(figure: Figure) -> None:
    """Take the names of files and loops in titles and labels literally.

    Matplotlib takes what stands between two dollar signs for a formula.
    """
    for text in figure.findobj(Text):
        if (written := text.get_text()) and ("$" in written or not written.isascii()):
            text.set_parse_math(False)
            text.set_text(with_known_letters(written))


def svg(figure: Figure) -> str:
    """Return a figure as an SVG element, to stand inside an HTML page."""
    buffer = io.StringIO()
    _write_names_as_they_are(figure)
    figure.savefig(buffer, format="svg")
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def identification_figure(
    op: Array, pv: Array, sp: Array | None, result: Identification, *, title: str
) -> Figure:
    """Draw OP with the estimated stem, PV with its model, PV over OP, and the cost surface."""
    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.0, 1.0, 1.5))
    t = np.arange(op.size) * result.period_s
    upper = figure.add_subplot(grid[0, :])
    lower = figure.add_subplot(grid[1, :], sharex=upper)
    upper.plot(t, op, color=OP, lw=1.0, label="OP (recorded)")
    lower.plot(t, pv, color=PV, lw=1.0, label="PV (recorded)")
    if sp is not None:
        lower.plot(t, sp, color=MARK, lw=0.9, ls="--", label="SP")
    upper.plot(t, result.stem, color=STEM, lw=1.2, label="stem (estimated)")
    lower.plot(t, result.pv_model, color=MODEL, lw=1.0, label="PV (model)")
    upper.set_ylabel("OP")
    lower.set(xlabel="time / s", ylabel="PV")
    # The model begins at rest, perhaps far off: what was recorded sets the scale.
    shown = pv if sp is None else np.concatenate([pv, sp])
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    if high > low:
        lower.set_ylim(low - SCALE_MARGIN * (high - low), high + SCALE_MARGIN * (high - low))
    for axes in (upper, lower):
        # Above the axes, where it covers no curve.
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize="small", frameon=False
        )
        axes.margins(x=0.0)
    figure.suptitle(f"{title}: {_verdict_text(result)}")
    _phase(figure.add_subplot(grid[2, 0]), op, pv, result)
    _surface(figure.add_subplot(grid[2, 1]), result)
    return figure


def _verdict_text(result: Identification) -> str:
    words = result.verdict.value.replace("_", " ") + (" (uncertain)" if result.uncertain else "")
    return (
        f"{words}, score {result.shown_score:.1f}" if math.isfinite(result.shown_score) else words
    )


def _phase(axes: Axes, op: Array, pv: Array, result: Identification) -> None:
    axes.plot(op, pv, color=OP, lw=0.6, label="over OP")
    axes.plot(result.stem, pv, color=STEM, lw=0.0, marker=".", ms=2.0, label="over the stem")
    axes.set(xlabel="OP, stem", ylabel="PV", title="PV over OP and over the estimated stem")
    axes.legend(fontsize="small")


def _surface(axes: Axes, result: Identification) -> None:
    axes.set(xlabel="stick band S", ylabel="slip jump J", title="cost over S and J (log scale)")
    surface = result.surface
    if surface is None or not np.isfinite(surface.cost).any():
        axes.text(0.5, 0.5, "not searched", ha="center", va="center", transform=axes.transAxes)
        return
    cost = np.log10(np.ma.masked_invalid(surface.cost))
    mesh = axes.pcolormesh(
        surface.stick_band, surface.slip_jump, cost.T, cmap="viridis", shading="nearest"
    )
    figure = axes.get_figure()
    assert figure is not None
    figure.colorbar(mesh, ax=axes, label="log10 of the cost; dark fits well")
    S, J = result.stick_band, result.slip_jump
    if np.isfinite([S.value, J.value]).all():
        across, up = ([[x.value - x.low], [x.high - x.value]] for x in (S, J))
        # A light edge keeps the cross visible on every colour of the map.
        for color, width in (("white", 4.0), (STEM, 1.6)):
            axes.errorbar(S.value, J.value, xerr=across, yerr=up, color=color, elinewidth=width)
