"""OPC UA devices in a site file: what is wrong is told in a sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import trustme
from asyncua import ua
from cryptography.hazmat.primitives import serialization

from fieldlink.links import LinkError, SystemClock, open_link
from fieldlink.links.opcua_session import OpcuaSession, StatusError
from fieldlink.site import Device, Site, SiteError, check, load_site
from tests.links.opcua_certificates import write_certificate


@pytest.mark.parametrize(
    ("opcua", "rows", "said"),
    [
        ('security = "Basic256Sha256"', "", "needs cert, key and server_cert"),
        ('username = "me"', "", "username and password_file belong together"),
        ('exchange_node = "Exchange"', "", "is not a node id"),
        ("", "X,Temperature\n", "is not a node id"),
        ("", "L0.OP,ns=1;s=L0.OP\n", "is already on line 2"),
        ('cert = "none.pem"\nkey = "none.key"', "", "there is no file"),
    ],
)
def test_a_wrong_device_is_reported_in_a_sentence(
    make_opcua_site: Callable[..., Site], opcua: str, rows: str, said: str
) -> None:
    with pytest.raises(SiteError, match=said):
        make_opcua_site(1, opcua=opcua, rows=rows)


def test_without_the_package_the_link_says_what_to_install(
    make_opcua_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch
) -> None:
    site = make_opcua_site(1)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(LinkError, match=r"pip install 'fieldlink\[opcua\]'"):
        open_link(site, "plc")


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (["a", "b"], "BadTypeMismatch; make exchange_node an array of UInt16"),
        ([1.5, 2.0], "BadTypeMismatch"),
        ([-1, 0], "BadTypeMismatch"),
        ([0x10000, 0], "BadTypeMismatch"),
        ([True, False], "BadTypeMismatch"),
        ([1], "BadIndexRangeNoData; the array is too short"),
        ([1, 2, 3], "the server does not support index ranges"),
        ("no array", "BadIndexRangeNoData"),
    ],
)
async def test_an_array_that_holds_no_registers_is_refused(
    make_opcua_site: Callable[..., Site],
    monkeypatch: pytest.MonkeyPatch,
    array: object,
    said: str,
) -> None:
    session = OpcuaSession("plc", *_device(make_opcua_site(1)), SystemClock())

    async def answer(_: object) -> list[ua.DataValue]:
        return [ua.DataValue(ua.Variant(array))]

    monkeypatch.setattr(session._client.uaclient, "read", answer)
    with pytest.raises(StatusError, match=said):
        await session.read_words("ns=1;s=E", 0, 2)


def _device(site: Site) -> tuple[Device, Site]:
    return site.devices["plc"], site


@pytest.mark.parametrize(
    ("begins", "ends", "said"),
    [(-60, -1, "was valid until"), (3, 60, "is valid from"), (-60, 10, "only"), (-60, 60, "")],
)
def test_check_warns_of_certificates_that_are_over(
    make_opcua_site: Callable[..., Site], tmp_path: Path, begins: int, ends: int, said: str
) -> None:
    for name in ("our", "server"):
        write_certificate(tmp_path, "urn:fieldlink:client", begins=begins, ends=ends, name=name)
    opcua = (
        'security = "Basic256Sha256"\ncert = "our.pem"\nkey = "our.key.pem"\n'
        'server_cert = "server.pem"'
    )
    site = make_opcua_site(4840, opcua=opcua)
    warned = [warning for warning in check(site).warnings if "cert" in warning]
    assert len(warned) == (2 if said else 0)
    assert all(said in warning for warning in warned)
    with site.path.open("a") as file:
        file.write(
            '\n[web]\ntls_certificate = "our.pem"\ntls_key = "our.key.pem"\n[opcua_server]\n'
            'cert = "our.pem"\nkey = "our.key.pem"\n[mqtt]\nhost = "b"\n[mqtt.tls]\n'
            'ca = "server.pem"\ncert = "our.pem"\nkey = "our.key.pem"\n'
        )
    warned = [warning for warning in check(load_site(site.path)).warnings if "cert" in warning]
    assert len(warned) == (5 if said else 0)
    assert all(said in warning for warning in warned)
    named = {warning.partition(" our.pem")[0] for warning in warned}
    assert named >= (
        {"web.tls_certificate", "opcua_server.cert", "mqtt.tls.cert"} if said else set()
    )
    (tmp_path / "server.pem").write_text("no certificate")
    assert any(
        "server.pem cannot be read as a certificate" in warning for warning in check(site).warnings
    )


async def test_a_server_that_takes_fewer_nodes_in_one_request_is_told_with_the_key(
    make_opcua_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = OpcuaSession("plc", *_device(make_opcua_site(1)), SystemClock())

    async def refuse(_: object) -> None:
        raise ua.UaStatusCodeError(ua.StatusCodes.BadTooManyOperations)

    monkeypatch.setattr(session._client.uaclient, "read", refuse)
    with pytest.raises(LinkError, match=r"BadTooManyOperations; .*: lower max_nodes"):
        await session.read_words("ns=1;s=E", 0, 2)


@pytest.mark.parametrize(
    ("cert", "key", "said"),
    [
        ("our.crt", "our.key.der", "Connection refused"),
        ("our.crt", "secret.pem", "secret.pem has a password; give the key without one"),
        ("our.crt", "junk.pem", "junk.pem holds no private key; give the key as PEM or DER file"),
        ("junk.pem", "our.key.pem", "junk.pem holds no certificate; give a certificate as PEM"),
        ("our.crt", "other.key.pem", "does not belong to the certificate; give the key of that"),
        ("ec.pem", "our.key.pem", "is not a certificate of an RSA key; make one with an RSA key"),
    ],
)
async def test_files_of_ours_are_not_an_answer_of_the_server(
    make_opcua_site: Callable[..., Site], tmp_path: Path, cert: str, key: str, said: str
) -> None:
    """PEM in a file with another ending is PEM, too."""
    for name in ("our", "other", "server"):
        write_certificate(tmp_path, "urn:fieldlink:client", name=name)
    (tmp_path / "our.crt").write_bytes((tmp_path / "our.pem").read_bytes())
    (tmp_path / "junk.pem").write_text("junk")
    authority = trustme.CA(key_type=trustme.KeyType.ECDSA)
    authority.cert_pem.write_to_path(tmp_path / "ec.pem")
    read = serialization.load_pem_private_key((tmp_path / "our.key.pem").read_bytes(), None)
    pkcs8 = serialization.PrivateFormat.PKCS8
    for name, form, lock in (
        ("our.key.der", serialization.Encoding.DER, serialization.NoEncryption()),
        ("secret.pem", serialization.Encoding.PEM, serialization.BestAvailableEncryption(b"x")),
    ):
        (tmp_path / name).write_bytes(read.private_bytes(form, pkcs8, lock))
    site = make_opcua_site(
        1,
        opcua=f'security = "Basic256Sha256"\ncert = "{cert}"\nkey = "{key}"\n'
        'server_cert = "server.pem"',
    )
    link = open_link(site, "plc")
    (failure,) = {str(failure) for failure in (await link.scan()).failures}
    await link.close()
    assert said in failure
    assert "answer" not in failure


def test_check_warns_of_a_certificate_for_another_application(
    make_opcua_site: Callable[..., Site], tmp_path: Path
) -> None:
    for name in ("our", "server"):
        write_certificate(tmp_path, "urn:another:client", name=name)
    opcua = (
        'security = "Basic256Sha256"\ncert = "our.pem"\nkey = "our.key.pem"\n'
        'server_cert = "server.pem"'
    )
    warned = [one for one in check(make_opcua_site(4840, opcua=opcua)).warnings if "_uri" in one]
    assert warned == [
        "device plc: cert our.pem names urn:another:client, and application_uri is "
        "urn:fieldlink:client: the server may refuse it; make them agree"
    ]


@pytest.mark.parametrize(
    ("status", "remedy"),
    [
        ("BadCertificateTimeInvalid", "renew our certificate"),
        ("BadCertificateUriInvalid", "make application_uri the URI that our certificate"),
        ("BadCertificateUntrusted", "let the server trust our certificate"),
        ("BadSecurityChecksFailed", "let the server trust our certificate"),
    ],
)
async def test_a_server_that_refuses_our_certificate_is_told_with_the_remedy(
    make_opcua_site: Callable[..., Site],
    monkeypatch: pytest.MonkeyPatch,
    status: str,
    remedy: str,
) -> None:
    async def refuse(_: object) -> None:
        raise ua.uaerrors.UaStatusCodeError(getattr(ua.StatusCodes, status))

    monkeypatch.setattr("fieldlink.links.opcua_session.Client.connect", refuse)
    link = open_link(make_opcua_site(4840), "plc")
    said = str((await link.scan()).failures[0])
    await link.close()
    assert f"{status}; {remedy}" in said
