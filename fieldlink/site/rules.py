"""What must hold between keys of a site file, and between it and the files it names."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from fieldlink.printable import as_printable, quoted
from fieldlink.registers import (
    BLOCK_REGISTERS,
    HEARTBEAT_EVERY,
    DataType,
    PlanError,
    Tag,
    plan_reads,
)
from fieldlink.site.checked_site import Site
from fieldlink.site.compensate_rules import compensate_fits
from fieldlink.site.errors import Problem, nearest
from fieldlink.site.exchange_rules import exchange_areas_fit
from fieldlink.site.models import Loop
from fieldlink.site.mqtt_rules import mqtt_fits
from fieldlink.site.named_files import find_missing
from fieldlink.site.notify_rules import notify_fits
from fieldlink.site.opcua_rules import opcua_fits
from fieldlink.site.opcua_server_rules import opcua_server_fits
from fieldlink.site.plant_rules import plant_fits
from fieldlink.site.toml_source import TomlSource

__all__ = ["find_problems"]

LONGEST_NAME = 200
"""Characters: a longer name does not fit on one line of a screen."""


def find_problems(site: Site, source: TomlSource) -> list[Problem]:
    """Return everything that is wrong with a site whose parts are each well-formed."""
    problems = [
        problem
        for name, loop in site.loops.items()
        for rule in _LOOP_RULES
        for problem in rule(site, source, name, loop)
    ]
    problems.extend(_one_kind_of_time(site, source))
    problems.extend(_printable(site, source))
    problems.extend(_readable(site, source))
    problems.extend(_certificates(site, source))
    problems.extend(mqtt_fits(site, source))
    problems.extend(notify_fits(site, source))
    problems.extend(opcua_server_fits(site, source))
    problems.extend(opcua_fits(site, source))
    problems.extend(_lines(site, source))
    problems.extend(exchange_areas_fit(site, source))
    return problems


def _one_kind_of_time(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Simulations and recordings go as fast as they can, and no device by the clock goes along."""
    used = dict.fromkeys(loop.device for loop in site.loops.values() if loop.device in site.devices)
    stepped = [name for name in used if site.devices[name].is_stepped]
    clocked = [name for name in used if not site.devices[name].is_stepped]
    if stepped and clocked:
        name, link = stepped[0], site.devices[stepped[0]].link
        yield source.problem(
            ("devices", name, "link"),
            f"{link} runs in virtual time, and device {clocked[0]!r} by the clock",
            "give each kind a site file of its own",
        )


def _printable(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Names go to terminals, logs and labels of metrics: nothing in them may be obeyed there.

    A broker ends a connection over a topic with such characters.
    """
    names: dict[tuple[str, ...], str] = {
        ("site", "name"): site.name,
        **{("devices", name): name for name in site.devices},
        **{("loops", name): name for name in site.loops},
        **{("loops", name, "area"): loop.area for name, loop in site.loops.items()},
    }
    if (mqtt := site.file.mqtt) is not None:
        keys = ("topic", "group", "node", "client_id")
        names |= {("mqtt", key): getattr(mqtt, key) or "" for key in keys}
    for key, name in names.items():
        if not name.isprintable():
            yield source.problem(
                key,
                f"{quoted(as_printable(name))} has characters that cannot be printed",
                "remove them",
            )
        elif len(name) > LONGEST_NAME:
            yield source.problem(
                key,
                f"{quoted(name)} has {len(name)} characters",
                f"shorten it to {LONGEST_NAME} or less",
            )
        elif key[0] == "loops" and name in (".", ".."):
            # A browser takes the last part of /loops/.. for the folder above: a page without a way.
            yield source.problem(key, f"{quoted(name)} cannot be part of an address", "rename it")


def _known_device(site: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    if loop.device not in site.devices:
        yield source.problem(
            ("loops", name, "device"),
            f"no device is named {loop.device!r}",
            nearest(loop.device, site.devices),
        )


def _tags_exist(site: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    if loop.device not in site.maps:
        return
    tags = site.maps[loop.device]
    for role in ("op", "pv", "sp", "mode", "scan"):
        wanted: str | None = getattr(loop, role)
        if wanted is None:
            continue
        key = ("loops", name, role)
        elsewhere = [device for device, others in site.maps.items() if wanted in others]
        if wanted in tags:
            yield from _fits_role(source, key, role, tags[wanted])
        elif elsewhere:
            yield source.problem(
                key,
                f"{wanted} is a tag of device {elsewhere[0]!r}, the loop is on {loop.device!r}",
                "OP, PV and the rest of a loop must come from one device: map the tag there",
            )
        else:
            yield source.problem(
                key, f"no register map has the tag {wanted!r}", nearest(wanted, tags)
            )
    if loop.op == loop.pv:
        yield source.problem(
            ("loops", name, "pv"), f"{loop.pv} is the loop's OP too", "name the process variable"
        )


def _fits_role(source: TomlSource, key: tuple[str, ...], role: str, tag: Tag) -> Iterator[Problem]:
    kind = tag.data_type
    if kind is DataType.STRING or (role in ("op", "pv") and kind is DataType.BOOL):
        yield source.problem(
            key, f"{tag.name} is a {kind} in the register map", "name a tag that holds a number"
        )
    if role in ("op", "pv", "scan") and tag.every:
        yield source.problem(
            key,
            f"{tag.name} is read every {tag.every:g} s only (column every of the register map)",
            "samples need a fresh value in every scan: leave every empty for this tag",
        )


def _beats(_: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    if loop.estimate_every is not None and loop.estimate_every < loop.period:
        yield source.problem(
            ("loops", name, "estimate_every"),
            f"{loop.estimate_every:g} s is shorter than the period of {loop.period:g} s",
            "a quarter to a half of the window (window x period) is usual",
        )


def _write_back_fits(site: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    device = site.devices.get(loop.device)
    if device is not None and device.link == "recording" and loop.writeback.enabled:
        yield source.problem(
            ("loops", name, "writeback", "enabled"),
            f"device {loop.device!r} replays recordings, nothing can be written to it",
            'remove the key, or serve the recording as a PLC with link = "modbus-tcp"',
        )
    area = loop.writeback.exchange is not None
    if device is not None and area and device.max_registers < BLOCK_REGISTERS:
        yield source.problem(
            ("loops", name, "writeback"),
            f"a block is read back as {BLOCK_REGISTERS} registers in one request, "
            f"max_registers of device {loop.device!r} is {device.max_registers}",
            f"raise it to {BLOCK_REGISTERS} or remove the exchange area",
        )


def _heartbeat_lives(site: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    """A request that times out holds up the next heartbeat: readers must not call it dead."""
    device = site.devices.get(loop.device)
    if device is None or device.is_stepped or not loop.writeback.enabled:
        return
    # A plant served faster than real time has its time-outs in seconds of the wall.
    longest = HEARTBEAT_EVERY + 2.0 * device.timeout
    allowed = loop.compensate.heartbeat_timeout
    if device.speed == 1.0 and longest > allowed:
        yield source.problem(
            ("loops", name, "compensate", "heartbeat_timeout"),
            f"the heartbeat comes every {HEARTBEAT_EVERY:g} s, and {longest:g} s apart when "
            f"requests time out; it would be called dead after {allowed:g} s",
            f"lower the timeout of device {loop.device!r}, or raise heartbeat_timeout",
        )


def _readable(site: Site, source: TomlSource) -> Iterator[Problem]:
    for name, device in site.devices.items():
        if device.is_opcua:
            continue
        for tag in site.maps.get(name, {}).values():
            try:
                plan_reads([tag], device.max_gap, device.max_registers, device.ranges)
            except PlanError as error:
                yield source.problem(("devices", name), *str(error).split("; ", 1))


def _certificates(site: Site, source: TomlSource) -> Iterator[Problem]:
    for name, device in site.devices.items():
        keys = ("ca", "cert", "key", "plc_cert", "plc_key") if device.tls is not None else ()
        files: dict[tuple[str, ...], Path | None] = {
            ("devices", name, "tls", key): getattr(device.tls, key) for key in keys
        }
        yield from find_missing(site, source, files)


def _lines(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Devices on one serial line must agree about its settings."""
    first_of: dict[str, str] = {}
    for name, device in site.devices.items():
        if device.serial_port is None:
            continue
        first = first_of.setdefault(os.path.realpath(device.serial_port), name)
        if device.serial_port != (known := site.devices[first].serial_port):
            yield source.problem(
                ("devices", name, "serial_port"),
                f"{device.serial_port} is the same port as {known} of {first!r}",
                "write the same name for both, so that they take turns on it",
            )
        for key in ("baud", "parity", "stop_bits"):
            mine, theirs = getattr(device, key), getattr(site.devices[first], key)
            if mine != theirs:
                yield source.problem(
                    ("devices", name, key),
                    f"{mine} here, {theirs} for {first!r} on the same {device.serial_port}",
                    "give all devices of a serial line the same settings",
                )


_LOOP_RULES = (
    _known_device,
    _tags_exist,
    _beats,
    plant_fits,
    compensate_fits,
    _write_back_fits,
    _heartbeat_lives,
)
