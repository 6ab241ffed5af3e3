"""``fieldlink --version`` and ``fieldlink support-bundle``."""

from __future__ import annotations

import errno
import json
import platform
import shutil
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.errors import FieldlinkError

SITES = Path(__file__).resolve().parents[2] / "site_configs"
SECRET = "hunter2/with@sign"
HOOK = "T0123/B4567"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    shutil.copy(SITES / "demo.csv", tmp_path)
    text = (SITES / "demo.toml").read_text()
    text += f'\n[historian]\nurl = "postgresql+psycopg://meyer:{SECRET}@127.0.0.1:1/plant"\n'
    text += '\n[web]\ntoken_file = "token"\n# token = "sesam-open"  password: abc\n'
    text += '\n[notify]\npage = "http://127.0.0.1:9480"\n[notify.web_hook]\n'
    text += f'url = "https://chat.example/hooks/{HOOK}"\n'
    (tmp_path / "token").write_text("file-secret\n")
    (tmp_path / "token").chmod(0o600)
    (tmp_path / "site.toml").write_text(text)
    return tmp_path / "site.toml"


def bundle(*arguments: str | Path) -> dict[str, str]:
    out = Path(arguments[-1])
    result = CliRunner().invoke(app, ["support-bundle", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    with zipfile.ZipFile(out) as file:
        return {name: file.read(name).decode() for name in file.namelist()}


def test_the_version_names_what_computes() -> None:
    lines = CliRunner().invoke(app, ["--version"]).stdout.splitlines()
    assert lines[0] == f"fieldlink {version('fieldlink')}"
    assert lines[1].startswith(f"Python {platform.python_version()}")
    for package in ("numpy", "numba", "pymodbus", "fmpy", "sqlalchemy"):
        assert f"{package} {version(package)}" in lines


def test_a_disk_that_is_full_leaves_no_half_bundle(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    out = tmp_path / "bundle.zip"
    with monkeypatch.context() as patch:
        patch.setattr(zipfile.ZipFile, "writestr", full)
        result = CliRunner().invoke(app, ["support-bundle", str(site), "--out", str(out)])
    assert isinstance(result.exception, FieldlinkError)
    assert "cannot be written (No space left on device)" in str(result.exception)
    assert not out.exists()
    # the next one has its place
    assert "versions.json" in bundle(site, "--out", out)


def test_a_bundle_has_no_secrets_and_says_what_is_missing(site: Path, tmp_path: Path) -> None:
    parts = bundle(site, "--out", tmp_path / "bundle.zip")
    together = "\n".join(parts.values())
    for secret in ("hunter2", "with@sign", "sesam", "abc", "file-secret", HOOK):
        assert secret not in together
    assert 'token_file = "token"' in parts["site.toml"]
    assert json.loads(parts["check.json"])["loops"][0]["name"] == "FC101"
    assert json.loads(parts["versions.json"])["numpy"] == version("numpy")
    assert any("FC101.OP" in text for name, text in parts.items() if name.startswith("maps/"))
    # Nothing listens at the store's address: the bundle is written and says why it has no events.
    assert "127.0.0.1:1" in parts["events.json.missing.txt"]


def test_a_site_file_with_an_error_is_bundled_with_the_error(site: Path, tmp_path: Path) -> None:
    site.write_text(site.read_text().replace("window = 800", "windou = 800"))
    parts = bundle(site, "--out", tmp_path / "bundle.zip")
    assert "windou" in parts["site.toml"]
    assert "loops.FC101.windou" in parts["check.json.missing.txt"]


def test_a_bundle_replaces_no_file(tmp_path: Path) -> None:
    out = tmp_path / "bundle.zip"
    assert set(bundle("--out", out)) == {"versions.json"}
    before = out.read_bytes()
    result = CliRunner().invoke(app, ["support-bundle", "--out", str(out)])
    assert isinstance(result.exception, FieldlinkError)
    assert "exists" in str(result.exception)
    assert out.read_bytes() == before


def test_check_does_not_show_a_password_with_a_slash(site: Path) -> None:
    for options in ((), ("--json",)):
        shown = CliRunner().invoke(app, ["check", str(site), *options])
        assert shown.exit_code == 0, shown.output
        assert "meyer:***@127.0.0.1:1/plant" in shown.stdout
        assert "hunter2" not in shown.stdout
        assert "@sign" not in shown.stdout
