"""What a site file allows and what is yet unwise, one sentence each, for ``fieldlink check``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain

from fieldlink.file_at import why_not_writable
from fieldlink.registers import Apart, ReadRequest, Table, find_apart
from fieldlink.site.certificate_warnings import find_certificate_warnings
from fieldlink.site.checked_site import Site
from fieldlink.site.copied_loops import find_copies
from fieldlink.site.folded_warnings import Warned, fold, shown
from fieldlink.site.missing_packages import find_missing_packages
from fieldlink.site.missing_rows import contradicts_clock
from fieldlink.site.models import Loop
from fieldlink.site.reach_warnings import find_reach_warnings
from fieldlink.site.recording import read_recording
from fieldlink.site.role_warnings import find_role_warnings

__all__ = ["find_apart_tags", "find_warnings"]


LINE_SHARE = 0.8
"""The share of a serial line that scans may take; the rest is for writes and slow devices."""

BITS_PER_BYTE = 11
"""Start bit, eight data bits, parity or a second stop bit, stop bit."""


FIRST_IN_MANUALS = {Table.HOLDING: 40001, Table.INPUT: 30001}
"""Where manuals begin to count the registers of a table whose first address is 0."""


LONG_TIMEOUT = 30.0
"""Seconds that no PLC takes to answer; who writes more may mean milliseconds."""


def find_warnings(site: Site, requests: Mapping[str, tuple[ReadRequest, ...]]) -> Iterator[str]:
    """Yield the warnings of devices, serial lines and loops; ``requests`` are by device.

    What holds for many of them is one warning.
    """
    yield from fold(
        warned for name in site.devices for warned in _device_warnings(site, name, requests[name])
    )
    yield from _line_warnings(site, requests)
    if why := why_not_writable(site.data_dir):
        yield (
            f"data_dir {site.data_dir} cannot be written ({why}): run would not start; name a "
            "folder that this user may write, or check as the user that runs the daemon"
        )
    yield from find_missing_packages(site)
    yield from find_certificate_warnings(site)
    yield from _mode_warnings(site)
    yield from fold(
        warned
        for name, loop in site.loops.items()
        for warned in (
            *_loop_warnings(name, loop),
            *find_role_warnings(site, name),
            *find_reach_warnings(site, name, loop),
            *_recording_warnings(site, name, loop),
        )
    )
    yield from find_copies(site)


def find_apart_tags(
    site: Site, name: str, requests: tuple[ReadRequest, ...], groups: Iterable[tuple[str, ...]]
) -> dict[tuple[str, ...], Apart]:
    """Return which groups of tags no single request of a device can bring, and why."""
    device = site.devices[name]
    found = find_apart(
        requests,
        list(dict.fromkeys(groups)),
        device.max_registers,
        device.ranges,
        one_tag=device.quirks.one_request_per_tag,
    )
    return {apart.tags: apart for apart in found}


def _device_warnings(site: Site, name: str, requests: tuple[ReadRequest, ...]) -> Iterator[Warned]:
    device, loops = site.devices[name], site.loops_of(name)
    if not loops:
        yield Warned("device", name, "no loop uses it")
    if device.timeout > LONG_TIMEOUT:
        yield Warned(
            "device",
            name,
            f"timeout = {device.timeout:g} is in seconds; without an answer nothing is read for so "
            "long",
        )
    if loops and device.speed != 1.0 and all(loop.plant is None for loop in loops.values()):
        yield Warned(
            "device",
            name,
            f"speed = {device.speed:g} is for a simulated plant, and no loop of it is simulated "
            "here: of a real one every period would be wrong, so remove it",
        )
    groups = {loop_name: _groups(loop) for loop_name, loop in loops.items() if name in site.maps}
    apart = find_apart_tags(site, name, requests, chain.from_iterable(groups.values()))
    for loop_name, of_loop in groups.items():
        for group in of_loop:
            if group in apart:
                cannot = f"cannot come from one request: {apart[group].reason.value}"
                roles = "OP and PV" if len(group) == 2 else "OP, PV and scan"
                yield Warned("loop", loop_name, f"{', '.join(group)} {cannot}", f"{roles} {cannot}")
                break
    views: dict[tuple[str, int], list[str]] = {}
    tags = site.maps.get(name, {}).values()
    for table, first in FIRST_IN_MANUALS.items():
        addresses = [tag.address for tag in tags if tag.table is table and not tag.node]
        if addresses and first <= min(addresses) and max(addresses) < first + 9999:
            yield Warned(
                "device",
                name,
                f"every {table} address is from {first} on, as manuals count: if theirs are "
                f"meant, subtract {first}, so that {first} becomes 0",
            )
    for tag in tags:
        if tag.bit is not None:
            # Bits of a status word are meant to share it.
            continue
        views.setdefault((tag.table.value, tag.address), []).append(tag.name)
    for (table_name, address), names in views.items():
        if len(names) > 1:
            same = f"are the same registers ({table_name} {address})"
            yield Warned(
                "device", name, f"{shown(names)} {same}", "have tags of the same registers"
            )


def _groups(loop: Loop) -> list[tuple[str, ...]]:
    """Return the tags of a loop that should be of one moment, the smaller group first."""
    pair = (loop.op, loop.pv)
    return [pair] if loop.scan is None else [pair, (*pair, loop.scan)]


def _line_warnings(site: Site, requests: Mapping[str, tuple[ReadRequest, ...]]) -> Iterator[str]:
    """Say when a serial line cannot carry what its loops need."""
    lines: dict[str, list[str]] = {}
    for name, device in site.devices.items():
        if device.serial_port is not None:
            lines.setdefault(device.serial_port, []).append(name)
    for port, names in lines.items():
        baud = site.devices[names[0]].baud
        share = sum(
            _seconds_on_line(request, baud)
            / max(site.poll_period(name) * request.polls, request.every)
            for name in names
            for request in requests[name]
        )
        if share > LINE_SHARE:
            yield (
                f"line {port}: the scans of {', '.join(names)} take {share:.0%} of the time at "
                f"{baud} baud: raise baud, drop tags or give them a rate (column every), or "
                "lengthen the periods"
            )


def _seconds_on_line(request: ReadRequest, baud: int) -> float:
    """Return what a request, its reply and the pauses of the standard take, without the device."""
    data = (request.count + 7) // 8 if request.table.is_bits else 2 * request.count
    asked, answered, pauses = 8, 5 + data, 7.0
    return (asked + answered + pauses) * BITS_PER_BYTE / baud


def _mode_warnings(site: Site) -> Iterator[str]:
    names = [name for name, loop in site.loops.items() if loop.mode is None and loop.plant is None]
    if len(names) == 1:
        yield f"loop {names[0]}: without a mode tag, samples in manual cannot be recognised"
    elif names:
        yield (
            f"{len(names)} loops without a mode tag ({shown(names)}): samples in manual cannot be "
            "recognised"
        )


def _loop_warnings(name: str, loop: Loop) -> Iterator[Warned]:
    span = loop.window * loop.period
    if loop.estimate_period > span:
        yield Warned(
            "loop",
            name,
            f"estimate_every = {loop.estimate_period:g} s is longer than the window of {span:g} s: "
            "samples between are never judged",
        )
    area = loop.writeback.exchange
    counted = FIRST_IN_MANUALS[Table.HOLDING]
    if area is not None and min(first for _, first, _ in area.spans()) >= counted:
        yield Warned(
            "loop",
            name,
            f"its exchange area begins at {counted} or later, as manuals count: if their numbers "
            f"are meant, subtract {counted}, or other registers are written",
        )
    if loop.compensate.enabled and loop.mode is None and loop.plant is None:
        yield Warned(
            "loop",
            name,
            "compensate is enabled without a mode tag: fieldlink compensate would write OP in "
            "manual, too, unless the PLC clears the enable bit then",
        )
    if loop.writeback.enabled and loop.writeback.valid_for < 2 * loop.estimate_period:
        yield Warned(
            "loop",
            name,
            f"a block is valid for {loop.writeback.valid_for} s, less than two estimates take "
            f"({2 * loop.estimate_period:g} s): it may expire while all is well",
        )


def _recording_warnings(site: Site, name: str, loop: Loop) -> Iterator[Warned]:
    if loop.plant is None or loop.plant.recording is None:
        return
    recording = read_recording(site.resolve(loop.plant.recording), period=loop.period)
    if contradicts_clock(recording):
        yield Warned(
            "loop",
            name,
            f"the times in {loop.plant.recording} are not {loop.period:g} s apart: correct period, "
            "or each row counts as one period",
        )
