"""Where a command for a single device goes: a device of a site file, a host, or a serial port."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from fieldlink.site import Device, Site

__all__ = [
    "Baud",
    "Ca",
    "Cert",
    "DeviceName",
    "Framing",
    "Key",
    "Parity",
    "ServerName",
    "StopBits",
    "Target",
    "TargetArgument",
    "Timeout",
    "Unit",
    "find_target",
]

TargetArgument = Annotated[
    str,
    typer.Argument(
        metavar="TARGET",
        help="A site file, HOST[:PORT], or a serial port such as /dev/ttyUSB0.",
    ),
]
DeviceName = Annotated[
    str | None, typer.Option("--device", help="Device of the site file, where it has several.")
]
Unit = Annotated[int | None, typer.Option("--unit", min=0, max=255, help="Modbus unit id (1).")]
Framing = Annotated[
    Literal["tcp", "tls", "rtu-tcp", "udp"],
    typer.Option("--transport", help="How a host is spoken to."),
]
Baud = Annotated[int, typer.Option(min=50, help="Bits per second of a serial port.")]
Parity = Annotated[Literal["none", "even", "odd"], typer.Option(help="Parity of a serial port.")]
StopBits = Annotated[int, typer.Option(min=1, max=2, help="Stop bits of a serial port.")]
Timeout = Annotated[float | None, typer.Option(min=0.01, help="Seconds to wait for a reply (0.5).")]
Ca = Annotated[
    Path | None,
    typer.Option(help="With --transport tls: certificates that may have signed the device's own."),
]
Cert = Annotated[Path | None, typer.Option(help="With --transport tls: our certificate.")]
Key = Annotated[Path | None, typer.Option(help="With --transport tls: private key of --cert.")]
ServerName = Annotated[
    str | None,
    typer.Option(help="With --transport tls: name in the device's certificate, if not its host."),
]


@dataclass(frozen=True, slots=True)
class Target:
    """A device, its name, and the site it is from (None for a host or a port)."""

    name: str
    device: Device
    site: Site | None

    @property
    def resolve(self) -> Callable[[str | Path], Path]:
        """Finds the files that the device names."""
        return Path if self.site is None else self.site.resolve


def find_target(
    target: str,
    *,
    device: str | None = None,
    unit: int | None = None,
    transport: str = "tcp",
    baud: int = 19200,
    parity: str = "even",
    stop_bits: int = 1,
    timeout: float | None = None,
    ca: Path | None = None,
    cert: Path | None = None,
    key: Path | None = None,
    server_name: str | None = None,
) -> Target:
    """Return what ``target`` means; options about transports count for hosts and ports alone.

    Raises:
        typer.BadParameter: it means nothing, or the site has several devices or none of that name,
            or the certificates are not for it.
        SiteError: the site file cannot be used.
    """
    from fieldlink.site import load_site

    changes: dict[str, Any] = {} if timeout is None else {"timeout": timeout}
    files = {"ca": ca, "cert": cert, "key": key, "server_name": server_name}
    tls = {name: given for name, given in files.items() if given is not None}
    if tls and (target.endswith(".toml") or transport != "tls"):
        raise typer.BadParameter(
            "certificates are for a host with --transport tls; a site file has its own",
            param_hint="--" + next(iter(tls)).replace("_", "-"),
        )
    if target.endswith(".toml"):
        site = load_site(target)
        name = _device_of(site, device)
        if unit is not None:
            changes["unit"] = unit
        if changes:
            site = site.with_device(name, **changes)
        return Target(name, site.devices[name], site)
    if device is not None:
        raise typer.BadParameter("only a site file has devices", param_hint="--device")
    return Target(
        target,
        _make_device(
            target,
            unit=1 if unit is None else unit,
            transport=transport,
            baud=baud,
            parity=parity,
            stop_bits=stop_bits,
            **({"tls": tls} if tls else {}),
            **changes,
        ),
        None,
    )


def _device_of(site: Site, device: str | None) -> str:
    names = [name for name, found in site.devices.items() if found.is_modbus or found.is_opcua]
    if device is None and len(names) == 1:
        return names[0]
    if device not in names:
        asked = "name one" if device is None else f"{device!r} is none of them"
        known = ", ".join(names) or "none"
        raise typer.BadParameter(
            f"the site's devices on a network are: {known}; {asked}", param_hint="--device"
        )
    return device


def _make_device(
    target: str, *, transport: str, baud: int, parity: str, stop_bits: int, **keys: Any
) -> Device:
    from pydantic import ValidationError

    from fieldlink.site import Device

    if "/" in target or target.upper().startswith("COM"):
        keys |= {
            "link": "modbus-rtu",
            "serial_port": target,
            "baud": baud,
            "parity": parity,
            "stop_bits": stop_bits,
        }
    else:
        host, port = target, ""
        if target.count(":") == 1 or target.startswith("["):
            host, _, port = target.rpartition(":")
            host = host.strip("[]")
        keys |= {"link": f"modbus-{transport}", "host": host}
        if port:
            if not port.isdecimal():
                raise typer.BadParameter(f"{target!r}: {port!r} is no port", param_hint="TARGET")
            keys["port"] = int(port)
    try:
        return Device(register_map=Path("none"), **keys)
    except ValidationError as error:
        said = "; ".join(detail["msg"].removeprefix("Value error, ") for detail in error.errors())
        raise typer.BadParameter(f"{target!r}: {said}", param_hint="TARGET") from error
