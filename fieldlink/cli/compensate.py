"""``fieldlink compensate SITE --loop NAME``: the compensator beside a real PLC."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from typing import TYPE_CHECKING, Annotated

import typer

from fieldlink.cli.site import SiteFile

if TYPE_CHECKING:
    from fieldlink.compensate.service import CompensateService, Step, Verdict

__all__ = ["compensate"]


def compensate(
    site: SiteFile,
    loop: Annotated[str, typer.Option("--loop", help="The loop.")],
    write: Annotated[
        bool,
        typer.Option("--write", help="Write OP where site file and PLC allow it; else a dry run."),
    ] = False,
    duration: Annotated[
        float | None, typer.Option(min=0.0, help="Seconds to run; else until SIGTERM or SIGINT.")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Print every Nth scan only.")] = 10,
) -> None:
    """Compute OP for one loop from its parameter block; print it, and write it with --write.

    Every change of the outcome for OP is printed. Fieldlink's daemon has to run beside it: the
    block counts only while its heartbeat does.
    """
    from fieldlink.compensate.service import CompensateService
    from fieldlink.daemon import configure_logging, stop_on_signals
    from fieldlink.site import load_site

    configure_logging()
    loaded = load_site(site)
    service = CompensateService(loaded, loop, write=write, tell=typer.echo)
    if not service.writes:
        why = "without --write" if not write else "compensate.enabled is not true"
        typer.echo(f"dry run ({why}): nothing will be written")
    beat = service.loop.period / loaded.devices[service.loop.device].speed

    async def work() -> Counter[Verdict]:
        with stop_on_signals() as stop:
            if duration is not None:
                asyncio.get_running_loop().call_later(duration, stop.set)
            return await _run(service, beat, every, stop)

    counts = asyncio.run(work())
    for verdict, count in counts.most_common():
        typer.echo(f"{count} scans: {verdict.name.lower()}, {verdict.value}")


async def _run(
    service: CompensateService, beat: float, every: int, stop: asyncio.Event
) -> Counter[Verdict]:
    """Step on monotonic deadlines until it is stopped; a deadline that has passed is skipped."""
    counts: Counter[Verdict] = Counter()
    clock = asyncio.get_running_loop().time
    begin, slot, last = clock(), 0, None
    await service.open()
    try:
        while not stop.is_set():
            step = await service.step(slot * service.loop.period)
            counts[step.verdict] += 1
            if step.verdict is not last or slot % every == 0:
                typer.echo(_line(slot, step))
            last = step.verdict
            slot = max(slot + 1, math.ceil((clock() - begin) / beat))
            try:
                async with asyncio.timeout(max(0.0, begin + slot * beat - clock())):
                    await stop.wait()
            except TimeoutError:
                continue
    finally:
        await service.close()
    return counts


def _line(slot: int, step: Step) -> str:
    op = "" if math.isnan(step.op) else f" -> {step.op:.3f}"
    words = f"  {step.detail}" if step.detail else ""
    return (
        f"{slot:6d}  PV {step.pv:.3f}  SP {step.sp:.3f}  OP {step.op_before:.3f}{op}  "
        f"{step.verdict.name.lower()}{words}"
    )
