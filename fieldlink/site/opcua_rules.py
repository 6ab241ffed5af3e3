"""What must hold between an OPC UA device, its loops and the files it names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.named_files import find_missing
from fieldlink.site.toml_source import TomlSource

__all__ = ["opcua_fits"]

_FILES = ("cert", "key", "server_cert", "password_file")


def opcua_fits(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Yield what is wrong with the OPC UA devices of a site."""
    for name, device in site.devices.items():
        if not device.is_opcua:
            continue
        files: dict[tuple[str, ...], Path | None] = {
            ("devices", name, "opcua", key): getattr(device.opcua, key) for key in _FILES
        }
        yield from find_missing(site, source, files)
        for loop_name, loop in site.loops_of(name).items():
            if loop.writeback.exchange is not None and device.opcua.exchange_node is None:
                yield source.problem(
                    ("loops", loop_name, "writeback"),
                    f"device {name!r} names no array for exchange areas",
                    f"add exchange_node to [devices.{name}.opcua], or remove the exchange area",
                )
