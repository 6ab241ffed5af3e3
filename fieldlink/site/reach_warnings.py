"""What a loop's tags cannot hold, as their types and scales in the register map stand.

Every mistake here gives plausible or missing samples and no error, so that only ``check`` can say
it: a scale that was forgotten or turned over, a mode that never comes, limits in percent for an OP
in counts.
"""

from __future__ import annotations

from collections.abc import Iterator

from fieldlink.one_window import LONGEST_WINDOW
from fieldlink.registers import DataType, Tag
from fieldlink.site.checked_site import Site
from fieldlink.site.folded_warnings import Warned
from fieldlink.site.models import Loop

__all__ = ["find_reach_warnings"]

COARSEST_COUNT = 1 / 200
"""The largest share of a range that one count may be worth: an eight-bit converter has 1/255, and
the stick bands of interest begin at one percent."""

ROUNDED = 1 / 200
"""The share of its range that a tag may lack at the end: many maps have 0.00305 for 100/32767."""

LEAST_LIMIT = 0.01
"""The share of OP's span that limits of the stick band must reach: less is no valve's."""

LONG_PERIOD = 300.0
"""Seconds that no loop's controller waits between two cycles; who writes more may mean
milliseconds."""


def find_reach_warnings(site: Site, name: str, loop: Loop) -> Iterator[Warned]:
    """Yield what the tags of the loop ``name`` cannot hold or tell apart."""
    if loop.period > LONG_PERIOD:
        yield Warned(
            "loop",
            name,
            f"period = {loop.period:g} is in seconds: a window takes "
            f"{loop.window * loop.period / 86400:.1f} days; if milliseconds are meant, divide by "
            "1000",
        )
    if loop.window > LONGEST_WINDOW:
        yield Warned(
            "loop",
            name,
            f"window = {loop.window} samples: above {LONGEST_WINDOW} one may need more memory or "
            "time than [estimation] gives, and is never judged then; take a shorter one",
        )
    for role in ("op", "pv"):
        tag = site.tag(name, role)
        if tag is not None and not tag.node:
            yield from _about_measurement(name, role.upper(), tag)
    mode = site.tag(name, "mode")
    if mode is not None and not mode.node:
        yield from _about_mode(name, loop, mode)
    scan = site.tag(name, "scan")
    if scan is not None and scan.scale != 1.0:
        what = f"scan is {scan.name}, which the register map scales by {scan.scale:g}"
        many = "counts of scan must be the PLC's own: leave its scale empty"
        yield Warned("loop", name, f"{what}: {many}", many)
    yield from _about_limits(site, name, loop)


def _about_measurement(name: str, role: str, tag: Tag) -> Iterator[Warned]:
    if tag.data_type.is_float or not tag.data_type.is_number:
        return
    unit = f" {tag.unit}" if tag.unit else ""
    low, high = tag.low, tag.high
    if (low is None or high is None) and tag.unit == "%":
        low, high = 0.0, 100.0
    if low is not None and high is not None and abs(tag.scale) > COARSEST_COUNT * (high - low):
        yield Warned(
            "loop",
            name,
            f"{role} {tag.name}: one count is {abs(tag.scale):g}{unit}, of a range from {low:g} to "
            f"{high:g}: smaller movements are lost; if a count is worth less, correct scale",
            f"one count of {role} is more than {COARSEST_COUNT:.1%} of its range: smaller "
            "movements are lost; if a count is worth less, correct scale",
        )
    # A low end that an unsigned type never reaches is room that does no harm.
    largest = tag.scale * tag.data_type.bounds[1] + tag.offset
    is_upright = tag.scale > 0.0
    column, limit, start = ("high", tag.high, tag.low)
    if not is_upright:
        column, limit, start = ("low", tag.low, tag.high)
    if limit is None:
        return
    missing = limit - largest if is_upright else largest - limit
    whole = abs(limit - (tag.offset if start is None else start))
    if missing > max(abs(tag.scale), ROUNDED * whole):
        kind = _with_article(tag.data_type)
        yield Warned(
            "loop",
            name,
            f"{role} {tag.name}: {kind} of this scale ends at {largest:g}{unit}, and {column} is "
            f"{limit:g}: correct type, scale or {column}",
            f"{role} ends before its range does, by type and scale: correct them or the range",
        )


def _about_mode(name: str, loop: Loop, mode: Tag) -> Iterator[Warned]:
    never = [value for value in loop.auto_values if not _can_be(mode, value)]
    if len(never) < len(loop.auto_values):
        return
    values = " or ".join(f"{value:g}" for value in never)
    kind = "one bit" if mode.bit is not None else _with_article(mode.data_type)
    yield Warned(
        "loop",
        name,
        f"mode {mode.name}, {kind}, is never {values}: no sample would count as in automatic; "
        "correct auto_values or the tag",
        "mode is never one of auto_values: no sample would count as in automatic; correct "
        "auto_values or the tag",
    )


def _can_be(tag: Tag, value: float) -> bool:
    if not tag.judge((value - tag.offset) / tag.scale).quality.is_good:
        return False
    if tag.data_type.is_float:
        return True
    raw = (value - tag.offset) / tag.scale
    low, high = tag.data_type.bounds
    return low <= raw <= high and abs(raw - round(raw)) < 1e-6


def _about_limits(site: Site, name: str, loop: Loop) -> Iterator[Warned]:
    span = site.op_span(name)
    if not loop.writeback.enabled or span is None:
        return
    highest = loop.writeback.limits.stick_band[1]
    if LEAST_LIMIT * span <= highest <= span:
        return
    yield Warned(
        "loop",
        name,
        f"limits of the stick band end at {highest:g}, and OP's span is {span:g}: they are in "
        "units of OP, not percent; correct limits (and deadband)",
    )


def _with_article(data_type: DataType) -> str:
    return f"{'an' if data_type.value.startswith('i') else 'a'} {data_type}"
