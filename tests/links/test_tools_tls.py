"""``fieldlink scan``, ``read`` and ``write`` of a host over Modbus Security."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fieldlink.cli.app import app
from fieldlink.errors import FieldlinkError
from fieldlink.lab.plc import Listening
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.modbus_device import modbus_device
from fieldlink.registers import Table
from tests.links.serving import served_in_a_thread

Files = Callable[[str], Path]


@pytest.fixture
def host(certificates: Files) -> Iterator[str]:
    image = RegisterImage()
    image.define(Table.HOLDING, 10, 5, writable=True)
    image.put(Table.HOLDING, 10, [425])
    place = Listening(
        link="modbus-tls",
        cert=certificates("plc.pem"),
        key=certificates("plc.key"),
        ca=certificates("ca.pem"),
    )
    with served_in_a_thread([modbus_device(image, 1)], place) as port:
        yield f"127.0.0.1:{port}"


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def tls(files: Files, who: str = "client") -> list[str]:
    mine = ["--cert", str(files(f"{who}.pem")), "--key", str(files(f"{who}.key"))]
    return ["--transport", "tls", "--ca", str(files("ca.pem")), "--timeout", "5", *mine]


def test_a_host_is_looked_at_read_and_written_with_certificates(
    host: str, certificates: Files
) -> None:
    looked = run("scan", host, "--units", "1", "--last", "20", *tls(certificates))
    assert "holding  10-14" in looked.output
    assert "10 = 425" in run("read", host, "10", *tls(certificates)).output
    assert "holds 7 now" in run("write", host, "10", "7", "--yes", *tls(certificates)).output


def test_another_name_in_the_certificate_can_be_given(host: str, certificates: Files) -> None:
    named = [*tls(certificates), "--server-name", "plc.plant.test"]
    assert "10 = 425" in run("read", host, "10", *named).output


def test_a_stranger_is_not_let_in(host: str, certificates: Files) -> None:
    result = run("read", host, "10", *tls(certificates, "stranger"))
    assert isinstance(result.exception, FieldlinkError)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--ca", "ca.pem"], "--transport tls"),
        (["--transport", "tls"], "tls"),
        (["--transport", "tls", "--ca", "ca.pem", "--cert", "c.pem"], "belong together"),
    ],
)
def test_certificates_that_do_not_fit_are_refused(arguments: list[str], said: str) -> None:
    result = run("read", "127.0.0.1:802", "10", *arguments)
    assert result.exit_code == 2
    assert said in " ".join(result.output.replace("│", " ").split())
