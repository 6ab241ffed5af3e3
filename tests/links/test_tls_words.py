"""Why certificates cannot be used, in words: no file names or lines of the libraries' source."""

from __future__ import annotations

import ssl
import subprocess
from pathlib import Path

import pytest

from fieldlink.links.transports import TlsFilesError, client_tls
from fieldlink.site.device import Tls


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    for name in ("a", "b"):
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "5", "-subj",
             f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.pem"],
            cwd=folder, check=True, capture_output=True,
        )  # fmt: skip
    (folder / "junk.pem").write_text("junk\n")
    return folder


@pytest.mark.parametrize(
    ("ca", "cert", "key", "expected"),
    [
        ("a.pem", "a.pem", "b.key", "the key does not belong to the certificate"),
        ("junk.pem", "a.pem", "a.key", "the file of the authority (ca) holds no certificate"),
        ("a.pem", "junk.pem", "a.key", "a certificate or key is not PEM text"),
        ("a.pem", "a.pem", "junk.pem", "a certificate or key is not PEM text"),
        ("a.pem", "nowhere.pem", "a.key", "nowhere.pem: No such file or directory"),
    ],
)
def test_the_message_says_what_is_wrong(
    folder: Path, ca: str, cert: str, key: str, expected: str
) -> None:
    tls = Tls(ca=Path(ca), cert=Path(cert), key=Path(key))
    with pytest.raises(TlsFilesError) as caught:
        client_tls(tls, "plc", lambda path: folder / path)
    said = str(caught.value)
    assert expected in said
    assert "_ssl" not in said
    assert "Errno" not in said
    assert "[" not in said


def test_files_that_fit_are_taken(folder: Path) -> None:
    tls = Tls(ca=Path("a.pem"), cert=Path("a.pem"), key=Path("a.key"))
    context = client_tls(tls, "plc", lambda path: folder / path)
    assert context.minimum_version is ssl.TLSVersion.TLSv1_2
