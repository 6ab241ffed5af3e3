"""Which kinds of link there are: a device's ``link`` key names one of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from fieldlink.links.base import Link
from fieldlink.links.clock import Clock, SystemClock
from fieldlink.links.errors import UnknownLinkKindError

if TYPE_CHECKING:
    from fieldlink.site import Site

__all__ = ["LinkFactory", "link_kinds", "open_link", "register_link"]

LinkFactory = Callable[["Site", str, Clock], Link]
"""Builds the link of one device: the site, the device's name, the clock that stamps readings."""


def _modbus(site: Site, device: str, clock: Clock) -> Link:
    from fieldlink.links.modbus import ModbusLink

    return ModbusLink.of_site(site, device, clock)


def _opcua(site: Site, device: str, clock: Clock) -> Link:
    from importlib.util import find_spec

    if find_spec("asyncua") is None:
        raise UnknownLinkKindError(
            device,
            'link = "opcua" needs the package asyncua',
            "pip install 'fieldlink[opcua]', or use another kind of link",
        )
    from fieldlink.links.opcua import OpcuaLink

    return OpcuaLink.of_site(site, device, clock)


def _recording(site: Site, device: str, clock: Clock) -> Link:
    from fieldlink.links.recorded import RecordedLink

    return RecordedLink(site, device, clock)


_FACTORIES: dict[str, LinkFactory] = {
    "modbus-tcp": _modbus,
    "modbus-rtu": _modbus,
    "modbus-rtu-tcp": _modbus,
    "modbus-udp": _modbus,
    "modbus-tls": _modbus,
    "opcua": _opcua,
    "recording": _recording,
}


def register_link(kind: str, factory: LinkFactory) -> None:
    """Make ``link = "kind"`` known in site files; the last registration of a kind counts."""
    _FACTORIES[kind] = factory


def link_kinds() -> tuple[str, ...]:
    """Return the registered kinds, sorted."""
    return tuple(sorted(_FACTORIES))


def open_link(site: Site, device: str, clock: Clock | None = None) -> Link:
    """Build the link of ``device``; `Link.open` is still the caller's to await.

    Raises:
        UnknownLinkKindError: nothing has registered the device's kind.
    """
    kind = site.devices[device].link
    factory = _FACTORIES.get(kind)
    if factory is None:
        known = ", ".join(link_kinds())
        raise UnknownLinkKindError(device, f"link = {kind!r} is not known", f"use one of: {known}")
    return factory(site, device, clock or SystemClock())
