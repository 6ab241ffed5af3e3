"""``fieldlink demo``: the whole chain over real Modbus TCP, watched live."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections import deque
from itertools import zip_longest
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any, Self

import typer
from typer.core import TyperCommand

if TYPE_CHECKING:
    from rich.console import Console
    from rich.panel import Panel

    from fieldlink.lab.demo.outcome import DemoOutcome
    from fieldlink.lab.demo.running import Course, Performance

__all__ = ["DemoCommand", "demo"]

BARS = "▁▂▃▄▅▆▇█"
WIDTH = 64


class DemoCommand(TyperCommand):
    """The command line of the demonstration: ``--hold`` may stand without its number."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Let ``--hold`` without a number mean endless."""
        given = []
        for option, following in zip_longest(args, args[1:], fillvalue="-"):
            given.append(option)
            if option == "--hold" and following.startswith("-") and not following[1:2].isdigit():
                given.append("inf")
        return super().parse_args(ctx, given)


def demo(
    recording: Annotated[
        Path | None, typer.Option(help="Replay this recorded loop through the PLC instead.")
    ] = None,
    output: Annotated[
        Path, typer.Option(help="Folder for the site, its data and the report.")
    ] = Path("fieldlink-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the plant's noise.")] = 1,
    hold: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Seconds for which PLC, daemon and page stay; without a number, until Ctrl-C.",
        ),
    ] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object only.")] = False,
) -> None:
    """Find a sticky valve in a simulated PLC over Modbus TCP and take its oscillation away.

    The page of the run is open from the start; --hold keeps it open afterwards.
    """
    import logging

    from fieldlink.cli.tables import data_console
    from fieldlink.lab.demo.site_files import PORT, recorded_scene, simulated_scene

    if recording is None:
        scene = simulated_scene(output, seed=seed)
    else:
        scene = recorded_scene(output, recording)
    # A folder that cannot be written is reported before anything is loaded.
    scene.write(PORT)

    from fieldlink.daemon import configure_logging
    from fieldlink.lab.demo.outcome import DemoOutcome
    from fieldlink.lab.demo.running import perform

    configure_logging(logging.WARNING)
    console = data_console(stderr=as_json, highlight=False)
    view = _View(console, scene.loop)
    _load_kernels(console)

    def finish(performance: Performance) -> None:
        from fieldlink.lab.demo.report import write_report

        view.end()
        found = performance.findings
        outcome = DemoOutcome.of(
            valve=scene.valve,
            stick_band=(found.stick_band.value, found.stick_band.low, found.stick_band.high),
            slip_jump=(found.slip_jump.value, found.slip_jump.low, found.slip_jump.high),
            truth=performance.course.truth,
            requests=performance.status.requests,
            late_slots=performance.status.late_slots,
            report=output / "report.html",
            page=performance.page,
        )
        write_report(scene, performance, outcome)
        if as_json:
            typer.echo(json.dumps(outcome.to_dict(), allow_nan=False))
        else:
            _print(console, scene.loop, outcome)
        if hold > 0.0:
            _say_address(console, performance, scene.loop, hold)

    with view:
        perform(
            scene,
            view.show,
            hold=hold,
            opened=lambda page: console.print(f"page: {page or 'no port, see the log'}"),
            finished=finish,
        )


def _print(console: Console, loop: str, outcome: DemoOutcome) -> None:
    from rich.table import Table

    from fieldlink.lab.demo.report import outcome_tables

    table = Table(title=f"loop {loop}", title_justify="left", show_header=False)
    for justify in ("left", "right", "right", "right"):
        table.add_column(justify=justify)
    for text in outcome_tables(outcome):
        table.add_row(*text.head, style="bold")
        for row in text.rows:
            table.add_row(*row)
        table.add_section()
    console.print(table)
    console.print(f"report: {outcome.report}")


def _say_address(console: Console, performance: Performance, loop: str, hold: float) -> None:
    from fieldlink.web import TOKEN_FILE

    site = performance.site
    layout = site.loops[loop].writeback.exchange
    device = site.devices[site.loops[loop].device]
    assert layout is not None
    until = f"for {hold:g} s more" if math.isfinite(hold) else "until Ctrl-C"
    console.print(
        f"page: {performance.page}, open {until}; for actions its token is in "
        f"{site.data_dir / TOKEN_FILE}"
    )
    console.print(
        f"the PLC goes on answering at {device.host}:{device.port} unit {device.unit}: "
        f"tags from register 0, exchange area from {layout.enable}, "
        f"banks at {layout.bank_a} and {layout.bank_b}"
    )


def _load_kernels(console: Console) -> None:
    """Compile the kernels where none are kept yet: no window of the demonstration waits for them.

    Raises:
        DemoError: they cannot be compiled.
    """
    from fieldlink.cli.kernels import are_compiled
    from fieldlink.lab.demo.site_files import DemoError

    if are_compiled():
        return
    console.print("compiling the numeric kernels (once on a machine, in minutes)")
    command = [sys.executable, "-c", "from fieldlink.cli.identify import warm_up; warm_up()"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        raise DemoError(f"the numeric kernels cannot be compiled: {last}; try: fieldlink warm-up")


class _View:
    """Live progress: on a terminal a panel that moves, elsewhere a line for every step."""

    def __init__(self, console: Console, loop: str) -> None:
        from rich.live import Live

        self._console = console
        self._loop = loop
        self._live = Live(console=console, refresh_per_second=8) if console.is_terminal else None
        self._step: object = None
        self._pv: deque[float] = deque(maxlen=WIDTH)
        self._slot = -1

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.end()

    def end(self) -> None:
        """Leave the last state on the terminal."""
        if self._live is not None:
            self._live.stop()

    def show(self, course: Course) -> None:
        """Show the newest sample, and print each new step of the run."""
        latest = course.status.latest
        if latest is not None and latest.slot != self._slot:
            self._slot = latest.slot
            self._pv.append(latest.pv)
        if self._live is not None:
            self._live.update(self._panel(course))
        if course.step is not self._step:
            self._step = course.step
            if self._live is None:
                self._console.print(f"{course.step.value}{self._found(course)}")

    def _panel(self, course: Course) -> Panel:
        from rich.panel import Panel
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 2))
        grid.add_row("now", Text(course.step.value, style="bold"))
        grid.add_row("", ProgressBar(total=1.0, completed=course.progress, width=WIDTH))
        grid.add_row("PV", Text(_spark(list(self._pv)), style="cyan"))
        grid.add_row("samples", str(course.status.counts.read))
        grid.add_row("requests", f"{course.requests}, late slots {course.late_slots}")
        grid.add_row("identified", Text(self._found(course).removeprefix(": ") or "-"))
        return Panel(grid, title=Text(f"loop {self._loop}"), title_align="left", width=WIDTH + 20)

    @staticmethod
    def _found(course: Course) -> str:
        estimate, accepted = course.status.last_estimate, course.status.last_accepted
        found = None if estimate is None else estimate.findings
        if accepted is not None:  # newer windows are under compensation
            found = accepted.candidate.findings
        if found is None:
            return ""
        S, J = found.stick_band, found.slip_jump
        return f": {found.verdict}, S {S.value:.4g}, J {J.value:.4g}"


def _spark(values: list[float]) -> str:
    """Return a line of bars for values; a gap where one is NaN."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return ""
    low, span = min(finite), (max(finite) - min(finite)) or 1.0
    top = len(BARS) - 1
    return "".join(
        BARS[round((value - low) / span * top)] if math.isfinite(value) else " " for value in values
    )
