"""A support bundle: one ZIP file with what a report of a defect needs, without secrets.

    write_bundle(Path("site.toml"), Path("bundle.zip"))

It holds ``versions.json``, and for a site the site file, its register maps, ``check.json`` and
``events.json``. A part that cannot be made is a text file that says why, because a bundle is wanted
most when something does not work. Files with passwords, tokens or keys are never opened.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

from fieldlink.daemon.reporting.logs import hide_secrets
from fieldlink.daemon.reporting.status_documents import event_document
from fieldlink.errors import FieldlinkError
from fieldlink.site import Site, check, load_site
from fieldlink.site.bounded_file import UnreadableFileError, read_bytes
from fieldlink.site.toml_source import LARGEST
from fieldlink.store import EventStream
from fieldlink.unfinished_file import remove_unfinished
from fieldlink.versions import find_versions

__all__ = ["EVENTS_KEPT", "BundleError", "write_bundle"]

EVENTS_KEPT = 200
"""Events in a bundle, the newest: about a day of a site with a fault that comes back."""

_ASSIGNED = re.compile(
    r"(?i)\b([\w-]*(?:password|passwd|token|secret|api_?key)\"?\s*[=:]\s*)"
    r"(\"[^\"]*\"|'[^']*'|[^\s;,&\"']+)"
)
"""A secret beside its name; keys that end in _file name a file and stay."""

_WEB_ADDRESS = re.compile(r"(?i)\b(https?://[^\s/\"'<>]+)/[^\s\"'<>]+")
"""The path of a web hook's address is often its only secret."""


class BundleError(FieldlinkError):
    """A bundle that cannot be written, or a part of it that cannot be read."""


def write_bundle(site: Path | None, out: Path) -> tuple[str, ...]:
    """Write a bundle and return the names of its parts.

    Args:
        site: the site file; None for versions alone.
        out: the new ZIP file.

    Raises:
        BundleError: ``out`` exists or cannot be written.
    """
    parts = {"versions.json": _as_json(find_versions())}
    if site is not None:
        parts |= _site_parts(site)
    try:
        file = out.open("xb")
    except FileExistsError as error:
        raise BundleError(f"{out}: the file exists; choose another name") from error
    except OSError as error:
        raise _unwritable(out, error) from error
    try:
        with file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as bundle:
            for name, text in parts.items():
                # a path in it may have bytes that are not UTF-8
                bundle.writestr(name, text.encode("utf-8", "backslashreplace"))
    except OSError as error:
        # half a bundle would be sent, and stand in the way of the next one
        remove_unfinished(out)
        raise _unwritable(out, error) from error
    return tuple(parts)


def _unwritable(out: Path, error: OSError) -> BundleError:
    return BundleError(f"{out}: cannot be written ({error.strerror or error}); choose another path")


def _site_parts(path: Path) -> dict[str, str]:
    parts: dict[str, str] = {}

    def add(name: str, make: Callable[[], str]) -> None:
        try:
            parts[name] = _hide(make())
        except FieldlinkError as error:
            parts[f"{name}.missing.txt"] = _hide(f"{error}\n")

    add("site.toml", lambda: _text(path))
    try:
        site = load_site(path)
    except FieldlinkError as error:
        parts["check.json.missing.txt"] = _hide(f"{error}\n")
        return parts
    add("check.json", lambda: _as_json(check(site).to_dict()))
    add("events.json", lambda: _events(site))
    for name, device in site.devices.items():
        if device.register_map is not None:
            file = site.resolve(device.register_map)
            # The device's name may hold what a file's name must not.
            plain = re.sub(r"[^\w-]", "_", name)
            add(f"maps/{len(parts):03}-{plain}.csv", lambda file=file: _text(file))  # type: ignore[misc]
    return parts


def _events(site: Site) -> str:
    events = EventStream(site.historian_url).begin(EVENTS_KEPT)
    return _as_json([event_document(event) for event in events])


def _text(path: Path) -> str:
    try:
        return read_bytes(path, most_megabytes=LARGEST).decode("utf-8", errors="replace")
    except UnreadableFileError as error:
        raise BundleError(f"{path}: {error}") from error


def _as_json(document: object) -> str:
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _hide(text: str) -> str:
    return hide_secrets(_ASSIGNED.sub(r'\1"***"', _WEB_ADDRESS.sub(r"\1/***", text)))
