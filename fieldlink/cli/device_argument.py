"""Where a command for a single device goes: a device of a site file, a host, or a serial port."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer

from fieldlink.printable import quoted
from fieldlink.whole_numbers import whole_number

if TYPE_CHECKING:
    from fieldlink.site import Device, Site

__all__ = ["Connect", "Target", "TargetArgument", "find_target", "takes_connection"]


@dataclass(frozen=True, slots=True)
class Connect:
    """The options of a command for a single device: how it is reached.

    The fields' types are what Typer asks for; `takes_connection` gives them to a command.
    """

    device: Annotated[
        str | None, typer.Option("--device", help="Device of the site file, where it has several.")
    ] = None
    unit: Annotated[
        int | None, typer.Option("--unit", min=0, max=255, help="Modbus unit id; 1, or the site's.")
    ] = None
    transport: Annotated[
        Literal["tcp", "tls", "rtu-tcp", "udp"],
        typer.Option("--transport", help="Protocol to a host."),
    ] = "tcp"
    baud: Annotated[int, typer.Option(min=50, help="Bits per second of a serial port.")] = 19200
    parity: Annotated[
        Literal["none", "even", "odd"], typer.Option(help="Parity of a serial port.")
    ] = "even"
    stop_bits: Annotated[int, typer.Option(min=1, max=2, help="Stop bits of a serial port.")] = 1
    timeout: Annotated[
        float | None, typer.Option(min=0.01, help="Seconds to wait for a reply; 0.5 unless given.")
    ] = None
    ca: Annotated[
        Path | None,
        typer.Option(help="For tls: certificates that may have signed the device's own."),
    ] = None
    cert: Annotated[Path | None, typer.Option(help="For tls: our certificate.")] = None
    key: Annotated[Path | None, typer.Option(help="For tls: private key of --cert.")] = None
    server_name: Annotated[
        str | None,
        typer.Option(help="For tls: name in the device's certificate, if not its host."),
    ] = None


def takes_connection(*, unit: bool = True) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of `Connect` instead of its parameter ``connect``.

    Args:
        unit: whether ``--unit`` is one of them.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(Connect, include_extras=True)
        own = get_type_hints(command, include_extras=True)
        options = [
            Parameter(
                option.name, Parameter.KEYWORD_ONLY, default=option.default,
                annotation=hints[option.name],
            )
            for option in fields(Connect)
            if unit or option.name != "unit"
        ]  # fmt: skip
        names = [option.name for option in options]

        @wraps(command)
        def run(**given: Any) -> None:
            chosen = {name: given.pop(name) for name in names}
            command(**given, connect=Connect(**chosen))

        parameters: list[Parameter] = []
        for parameter in signature(command).parameters.values():
            if parameter.name == "connect":
                parameters.extend(options)
                continue
            parameters.append(
                parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=own[parameter.name])
            )
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate


TargetArgument = Annotated[
    str,
    typer.Argument(
        metavar="TARGET",
        help="A site file, HOST[:PORT], or a serial port such as /dev/ttyUSB0.",
    ),
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


def find_target(target: str, connect: Connect) -> Target:
    """Return what ``target`` means; options about transports count for hosts and ports alone.

    Raises:
        typer.BadParameter: it means nothing, or the site has several devices or none of that name,
            or the certificates are not for it.
        SiteError: the site file cannot be used.
    """
    from fieldlink.site import load_site

    changes: dict[str, Any] = {} if connect.timeout is None else {"timeout": connect.timeout}
    files = {name: getattr(connect, name) for name in ("ca", "cert", "key", "server_name")}
    tls = {name: given for name, given in files.items() if given is not None}
    if tls and (target.endswith(".toml") or connect.transport != "tls"):
        raise typer.BadParameter(
            "certificates are for a host with --transport tls; a site file has its own",
            param_hint="--" + next(iter(tls)).replace("_", "-"),
        )
    if target.endswith(".toml"):
        site = load_site(target)
        name = _device_of(site, connect.device)
        if connect.unit is not None:
            changes["unit"] = connect.unit
        if changes:
            site = site.with_device(name, **changes)
        return Target(name, site.devices[name], site)
    if connect.device is not None:
        raise typer.BadParameter("only a site file has devices", param_hint="--device")
    return Target(
        target,
        _make_device(
            target,
            unit=1 if connect.unit is None else connect.unit,
            transport=connect.transport,
            baud=connect.baud,
            parity=connect.parity,
            stop_bits=connect.stop_bits,
            **({"tls": tls} if tls else {}),
            **changes,
        ),
        None,
    )


def _device_of(site: Site, device: str | None) -> str:
    names = [name for name, found in site.devices.items() if not found.is_stepped]
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
            keys["port"] = whole_number(port, 0xFFFF)
            if keys["port"] is None:
                raise typer.BadParameter(
                    f"{quoted(target)}: {quoted(port)} is not a port", param_hint="TARGET"
                )
    try:
        return Device(register_map=Path("none"), **keys)
    except ValidationError as error:
        said = "; ".join(detail["msg"].removeprefix("Value error, ") for detail in error.errors())
        raise typer.BadParameter(f"{target!r}: {said}", param_hint="TARGET") from error
