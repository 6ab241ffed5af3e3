"""The report of a demonstration: one HTML file that needs no network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import jinja2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimator import identify
from fieldlink.lab.demo.outcome import DemoOutcome, phases
from fieldlink.lab.demo.running import Performance
from fieldlink.lab.demo.site_files import DEVICE, DemoError, Scene
from fieldlink.pictures import MARK, MODEL, OP, PV, STEM, identification_figure, save, svg
from fieldlink.store import read_samples, read_writebacks

if TYPE_CHECKING:
    import pandas as pd

    from fieldlink.lab.plc import Truth

__all__ = ["TableText", "outcome_tables", "write_report"]


@dataclass(frozen=True, slots=True)
class TableText:
    """A table as text, for a terminal and for a page."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def outcome_tables(outcome: DemoOutcome) -> tuple[TableText, ...]:
    """Return the figures of a demonstration as tables of four columns."""
    valve = tuple(
        (name, _text(found.true), _text(found.value), f"{_text(found.low)} to {_text(found.high)}")
        for name, found in (
            ("stick band S", outcome.stick_band),
            ("slip jump J", outcome.slip_jump),
        )
    )
    course = tuple(
        (name, _text(change.before), _text(change.after), _text(change.ratio))
        for name, change in (
            ("PV standard deviation", outcome.pv_std),
            ("valve travel", outcome.valve_travel),
            ("reversals", outcome.reversals),
        )
    )
    traffic = (
        ("Modbus requests", str(outcome.requests), "", ""),
        ("late poll slots", str(outcome.late_slots), "", ""),
    )
    return (
        TableText(("the valve", "true", "identified", "90 % interval"), valve),
        TableText(("the loop, per 100 samples", "before", "after", "ratio"), course),
        TableText(("the wire", "", "", ""), traffic),
    )


def write_report(scene: Scene, performance: Performance, outcome: DemoOutcome) -> None:
    """Write the report to ``outcome.report``, and beside it the course of the run as a picture.

    Raises:
        DemoError, PictureError: a file cannot be written.
        StoreError: the historian of the run cannot be read.
    """
    site = performance.site
    samples = _window(site.historian_url, scene.loop, performance.slots)
    settings = site.loops[scene.loop].estimator
    result = identify(
        samples.op.to_numpy(),
        samples.pv.to_numpy(),
        sp=samples.sp.to_numpy(),
        auto=samples.auto.to_numpy(dtype=float),
        period=site.loops[scene.loop].period,
        criterion=settings.criterion,
        confidence=settings.confidence,
        surface=True,
    )
    course = _course(performance.course.truth, performance.slots)
    save(course, outcome.report.with_name("run.png"))
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fieldlink.lab.demo"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    device = site.devices[DEVICE]
    page = environment.get_template("report.html.j2").render(
        title=f"Loop {scene.loop}: from oscillation to parameter block",
        subtitle=f"fieldlink demo, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        summary=_summary(scene, outcome),
        tables=outcome_tables(outcome),
        run_figure=svg(course),
        run_caption=_caption(scene),
        identification_figure=svg(
            identification_figure(
                samples.op.to_numpy(),
                samples.pv.to_numpy(),
                samples.sp.to_numpy(),
                result,
                title=f"{scene.loop}, window behind the block",
            )
        ),
        confidence=f"{result.confidence:.0%}",
        reasons=[f"{reason.text}. {reason.advice}" for reason in result.reasons],
        block=[
            (row.address, row.name, f"{row.value:.10g} {row.unit}".strip())
            for row in performance.block
        ],
        address=f"{device.host}:{device.port}, unit {device.unit}",
        writes=_writes(read_writebacks(site.historian_url, scene.loop)),
        site_file=scene.file.name,
        site_text=scene.file.read_text("utf-8"),
    )
    try:
        outcome.report.write_text(page, "utf-8")
    except OSError as error:
        raise DemoError(
            f"{outcome.report}: the report cannot be written ({error.strerror or error}); "
            "name a writable folder with --output"
        ) from error


def _window(url: str, loop: str, slots: tuple[int, int]) -> pd.DataFrame:
    """The samples behind the block, one row a slot; slots that were missed are NaN."""
    frame = read_samples(url, loop).drop_duplicates("slot", keep="last").set_index("slot")
    return frame.reindex(range(slots[0], slots[1] + 1))


def _summary(scene: Scene, outcome: DemoOutcome) -> str:
    S = outcome.stick_band
    found = f"a stick band of {_text(S.value)} (90 % interval {_text(S.low)} to {_text(S.high)})"
    if scene.recording is not None:
        return (
            f"{scene.recording.name} was replayed through a PLC. The daemon read it over Modbus "
            f"TCP, identified {found} and wrote the parameter block into the PLC's registers."
        )
    return (
        f"The daemon read OP and PV over Modbus TCP, identified {found}; the true one is "
        f"{_text(S.true)}. It wrote the block, and the PLC's compensator took over: PV's standard "
        f"deviation fell to {_share(outcome.pv_std.ratio)} of what it was, valve travel to "
        f"{_share(outcome.valve_travel.ratio)}."
    )


def _share(ratio: float) -> str:
    return f"{100.0 * ratio:.3g} %" if np.isfinite(ratio) else "an unknown share"


def _caption(scene: Scene) -> str:
    if scene.recording is not None:
        return "OP and PV as replayed. The shaded part is the window behind the block."
    return (
        "What happened in the PLC, control cycle by control cycle. The stem is not measured; only "
        "the simulated plant knows it. The shaded part is the window behind the block; the line "
        "marks the cycle in which the compensator took over."
    )


def _course(truth: Truth, slots: tuple[int, int]) -> Figure:
    figure = Figure(figsize=(12.0, 5.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(truth.cycle, truth.op, color=OP, lw=0.9, label="OP")
    lower.plot(truth.cycle, truth.pv, color=PV, lw=0.9, label="PV")
    if np.isfinite(truth.stem).any():
        upper.plot(truth.cycle, truth.stem, color=STEM, lw=1.1, label="stem (true)")
    if np.isfinite(truth.sp).any():
        lower.plot(truth.cycle, truth.sp, color=MARK, lw=0.9, ls="--", label="SP")
    _, after = phases(truth)
    for axes in (upper, lower):
        axes.axvspan(*slots, color=MODEL, alpha=0.10, lw=0.0)
        if after is not None:
            axes.axvline(float(truth.cycle[truth.compensated][0]), color="black", lw=1.0)
        axes.legend(loc="lower right", ncols=3, fontsize="small")
        axes.margins(x=0.0)
    _label(upper, sum(slots) / 2.0, "judged window")
    if after is not None:
        begin = float(truth.cycle[truth.compensated][0])
        _label(upper, (begin + float(truth.cycle[-1])) / 2.0, "under the compensator")
    upper.set_ylabel("OP")
    lower.set(ylabel="PV", xlabel="control cycle")
    return figure


def _label(axes: Axes, cycle: float, text: str) -> None:
    """A word about a stretch of cycles, below the upper edge of the axes."""
    place = axes.get_xaxis_transform()
    axes.text(cycle, 0.97, text, transform=place, ha="center", va="top", fontsize="medium")


def _writes(frame: pd.DataFrame) -> TableText:
    columns: Mapping[str, str] = {
        "time": "time (UTC)",
        "outcome": "outcome",
        "seq": "seq",
        "bank": "bank",
        "status": "status",
        "stick_band": "S",
        "slip_jump": "J",
        "reason": "why",
    }
    rows = [tuple(_cell(row[name]) for name in columns) for row in frame.to_dict(orient="records")]
    return TableText(tuple(columns.values()), tuple(rows))


def _cell(value: object) -> str:
    if isinstance(value, datetime):
        return f"{value:%H:%M:%S}"
    if isinstance(value, float):
        return _text(value)
    return "" if value is None else str(value)


def _text(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"
