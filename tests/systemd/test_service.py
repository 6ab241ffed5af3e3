"""`fieldlink service`: a unit of the site's own paths, installed without losing what is there."""

from __future__ import annotations

import configparser
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fieldlink.cli.app import app
from fieldlink.errors import FieldlinkError
from fieldlink.systemd.unit import render_unit

ROOT = Path(__file__).resolve().parents[2]
DEPLOYED = ROOT / "deploy" / "systemd" / "fieldlink@.service"


def site_in(folder: Path, data_dir: str = "data", name: str = "unit 3 100%") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    text = (ROOT / "site_configs" / "two_loops.toml").read_text()
    text = text.replace('data_dir = "data-two-loops"', f'data_dir = "{data_dir}"')
    text = text.replace('name = "two loops"', f'name = "{name}"')
    for shared in ("two_loops.csv", "FC202.csv"):
        shutil.copy(ROOT / "site_configs" / shared, folder)
    file = folder / "site.toml"
    file.write_text(text)
    return file


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["service", *map(str, arguments)])


def parsed(text: str) -> configparser.RawConfigParser:
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(text)
    return parser


def test_the_unit_names_the_site_s_own_paths(tmp_path: Path) -> None:
    site = site_in(tmp_path / "a $1 folder")
    unit = parsed(run("show", site).stdout)
    # systemd.service(5): blanks in quotes, %% for %, and $$ for $ in a command
    typed = f'fieldlink run "{tmp_path}/a $$1 folder/site.toml"'
    assert unit["Service"]["ExecStart"].endswith(typed)
    assert unit["Service"]["ReadWritePaths"] == f'"{tmp_path}/a $1 folder/data"'
    assert unit["Unit"]["Description"] == "fieldlink, site unit 3 100%%"
    assert unit["Service"]["User"] == "fieldlink"
    assert "SupplementaryGroups" not in unit["Service"], "the site has no serial port"
    # A folder in /tmp must not be hidden behind a /tmp of the service's own.
    assert unit["Service"]["PrivateTmp"] == ("no" if str(tmp_path).startswith("/tmp") else "yes")
    own = parsed(run("show", site, "--user").stdout)
    assert not {"User", "Nice", "ProtectSystem", "StateDirectory"} & set(own["Service"])
    assert own["Install"]["WantedBy"] == "default.target"


@pytest.mark.parametrize(
    ("python", "said"), [("/home/ann/.pyenv/versions/3.11", "read-only"), ("/usr", "yes")]
)
def test_a_python_in_somebodys_home_is_not_hidden(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, python: str, said: str
) -> None:
    """With ProtectHome=yes the service would end with 203/EXEC: there is no interpreter."""
    monkeypatch.setattr(sys, "base_prefix", python)
    monkeypatch.setattr(sys, "executable", "/opt/fieldlink/bin/python")
    monkeypatch.setattr(shutil, "which", lambda _: "/opt/fieldlink/bin/fieldlink")
    service = parsed(run("show", site_in(tmp_path)).stdout)["Service"]
    assert service["ProtectHome"] == said


def test_serial_ports_are_open_and_the_clock_is_not(tmp_path: Path) -> None:
    """Before systemd 253 ProtectClock= stands for a list of devices that has the clock alone."""
    service = parsed(run("show", site_in(tmp_path)).stdout)["Service"]
    assert not {"ProtectClock", "DeviceAllow", "DevicePolicy"} & set(service)
    assert service["PrivateDevices"] == "no"
    assert service["CapabilityBoundingSet"] == "~CAP_SYS_TIME CAP_WAKE_ALARM"
    assert service["SystemCallFilter"] == "~@clock"


def test_systemd_makes_a_data_folder_below_var_lib(tmp_path: Path) -> None:
    service = parsed(run("show", site_in(tmp_path, "/var/lib/fieldlink/plant1")).stdout)["Service"]
    assert service["StateDirectory"] == "fieldlink/plant1"
    assert "ReadWritePaths" not in service


def test_installing_never_overwrites_silently(tmp_path: Path) -> None:
    site, units = site_in(tmp_path), tmp_path / "units"
    first = run("install", site, "--folder", units)
    file = units / "fieldlink-unit-3-100.service"
    assert first.exit_code == 0, first.output
    assert file.read_text() == run("show", site).stdout
    assert f"written: {file}" in first.stdout
    typed = [line.strip() for line in first.stdout.split("next:\n")[1].splitlines()]
    assert typed[-3:] == [
        "systemctl daemon-reload",
        "systemctl enable --now fieldlink-unit-3-100",
        "journalctl -u fieldlink-unit-3-100 -f",
    ]
    assert f"unchanged: {file}" in run("install", site, "--folder", units).stdout
    file.write_text("# somebody's own\n")
    refused = run("install", site, "--folder", units)
    assert isinstance(refused.exception, FieldlinkError)
    assert "is there already and differs" in str(refused.exception)
    assert file.read_text() == "# somebody's own\n"
    assert f"replaced: {file}" in run("install", site, "--folder", units, "--replace").stdout
    assert [path.name for path in units.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--run-as", "root\nExecStart=/bin/sh"), "not the name of an account"),
        (("--name", "///"), "a service cannot be named"),
    ],
)
def test_what_cannot_stand_in_a_unit_is_refused(
    tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    result = run("show", site_in(tmp_path), *options)
    assert said in str(result.exception)


def test_the_unit_in_deploy_is_that_of_the_package() -> None:
    text = DEPLOYED.read_text()
    assert text == render_unit(
        heading=text.split("\n[Unit]")[0],
        title="%i",
        program="/opt/fieldlink/bin/fieldlink",
        site="/etc/fieldlink/%i/site.toml",
        user="fieldlink",
        serial=True,
        state_directory="fieldlink/%i",
    )


@pytest.mark.parametrize("option", ["--system", "--user"])
def test_systemd_itself_agrees(tmp_path: Path, option: str) -> None:
    if (tool := shutil.which("systemd-analyze")) is None:
        pytest.skip("systemd-analyze is not here")
    site = site_in(tmp_path / "a folder")
    text = run("show", site, *(["--user"] if option == "--user" else ["--run-as", "root"])).stdout
    units = {"fieldlink-site.service": text}
    if option == "--system":
        units["fieldlink@.service"] = DEPLOYED.read_text().replace("=fieldlink\n", "=root\n")
    for name, unit in units.items():
        # Only what stands in for this machine's lack of an installation.
        (tmp_path / name).write_text(unit.replace("/opt/fieldlink/bin/fieldlink", "/bin/true"))
    command = [tool, "verify", option, "--man=no", *(str(tmp_path / name) for name in units)]
    result = subprocess.run(
        command, capture_output=True, text=True, check=False, env={"XDG_RUNTIME_DIR": str(tmp_path)}
    )
    ours = [line for line in result.stderr.splitlines() if "fieldlink" in line]
    assert ours == [], result.stderr
