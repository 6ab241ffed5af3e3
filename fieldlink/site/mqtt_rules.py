"""What must hold between the table ``[mqtt]`` and the rest of a site."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.named_files import find_missing
from fieldlink.site.toml_source import TomlSource

__all__ = ["mqtt_fits"]


def mqtt_fits(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Yield what is wrong with the files that ``[mqtt]`` names."""
    mqtt = site.file.mqtt
    if mqtt is None:
        return
    files: dict[tuple[str, ...], Path | None] = {("mqtt", "password_file"): mqtt.password_file}
    if mqtt.tls is not None:
        files |= {("mqtt", "tls", key): getattr(mqtt.tls, key) for key in ("ca", "cert", "key")}
    yield from find_missing(site, source, files)
