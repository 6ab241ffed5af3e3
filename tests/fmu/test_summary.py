"""What is printed about an FMU before anything of it runs."""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fieldlink.cli.fmu_tables import print_summary
from fmu_models import PlantFileError, catalogue, fmu_path, summarise

Minis = dict[str, Path]


def test_summary_of_a_plant() -> None:
    summary = summarise(fmu_path("heat"))
    assert (summary.name, summary.fmi_version, summary.kinds) == ("heat", "3.0", ("co-simulation",))
    assert summary.runs_here
    assert summary.has_sources
    assert summary.can_restore
    assert (summary.start_time, summary.stop_time, summary.step_size) == (0.0, 5000.0, 5.0)
    pv = summary.variable("pv")
    assert pv is not None
    assert (pv.unit, pv.causality, pv.settable) == ("degC", "output", False)
    assert summary.variable("nothing") is None


@pytest.mark.parametrize("name", sorted(catalogue))
def test_there_is_nothing_to_warn_of_in_our_plants(name: str) -> None:
    assert summarise(fmu_path(name)).warnings == ()
    assert summarise(fmu_path(name, 2)).warnings == ()


def test_summary_of_other_tools_fmus(mini_fmus: Minis) -> None:
    both = summarise(mini_fmus["fmi2"])
    assert both.kinds == ("co-simulation", "model exchange")
    mode = both.variable("mode")
    assert mode is not None
    assert mode.items == ((1, "slow"), (2, "fast"))
    first = summarise(mini_fmus["fmi1-me"])
    assert (first.fmi_version, first.kinds, first.states) == ("1.0", ("model exchange",), 1)
    assert (
        "it has no solver of its own (model exchange only): CVode integrates it" in first.warnings
    )
    assert "it offers no serialised state: no snapshots" in first.warnings


def test_a_library_that_would_crash_is_not_touched(mini_fmus: Minis, tmp_path: Path) -> None:
    file = tmp_path / "broken.fmu"
    with zipfile.ZipFile(mini_fmus["fmi2"]) as source, zipfile.ZipFile(file, "w") as copy:
        for name in source.namelist():
            copy.writestr(name, b"\x7fELF" if name.startswith("binaries") else source.read(name))
    assert summarise(file).runs_here


def test_only_another_platforms_library(mini_fmus: Minis, tmp_path: Path) -> None:
    file = tmp_path / "windows.fmu"
    with zipfile.ZipFile(mini_fmus["fmi2"]) as source, zipfile.ZipFile(file, "w") as copy:
        for name in source.namelist():
            if not name.startswith("binaries"):
                copy.writestr(name, source.read(name))
        copy.writestr("binaries/win64/mini2.dll", b"MZ")
    summary = summarise(file)
    assert summary.platforms == ("win64",)
    assert not summary.runs_here
    assert any("no library for this platform" in warning for warning in summary.warnings)
    done = CliRunner().invoke(app, ["run", str(file), "--stop", "1"])
    assert isinstance(done.exception, PlantFileError)
    assert "it offers win64" in str(done.exception)


def test_command_prints_it_and_as_json(mini_fmus: Minis) -> None:
    printed = CliRunner().invoke(app, ["info", str(mini_fmus["fmi2"]), "--all"])
    assert printed.exit_code == 0, printed.output
    for word in ("FMI", "co-simulation, model exchange", "linux64", "pump.on", "der(tank.h)"):
        assert word in printed.output
    machine = CliRunner().invoke(app, ["info", "ph", "--json"])
    described = json.loads(machine.output)
    assert described["name"] == "ph"
    assert {"op", "pv"} <= {variable["name"] for variable in described["variables"]}
    assert described["warnings"] == []


def test_a_unit_without_a_usable_factor_is_its_own_base(mini_fmus: Minis, tmp_path: Path) -> None:
    file = tmp_path / "odd.fmu"
    units = (
        b'<UnitDefinitions><Unit name="odd"><BaseUnit m="1" factor="NaN" offset="INF"/>'
        b'<DisplayUnit name="shown" factor="1e400" offset="-INF"/></Unit></UnitDefinitions>'
    )
    with zipfile.ZipFile(mini_fmus["fmi2"]) as source, zipfile.ZipFile(file, "w") as copy:
        for name in source.namelist():
            text = source.read(name)
            if name == "modelDescription.xml":
                text = re.sub(rb"<UnitDefinitions>.*</UnitDefinitions>", b"", text, flags=re.DOTALL)
                text = text.replace(b"<ModelVariables>", units + b"<ModelVariables>")
            copy.writestr(name, text)
    printed = CliRunner().invoke(app, ["info", str(file), "--json"]).stdout
    described = json.loads(printed, parse_constant=pytest.fail)
    (unit,) = described["units"]
    assert (unit["factor"], unit["offset"]) == (1.0, 0.0)
    assert unit["shown"] == [["shown", 1.0, 0.0]]


@pytest.mark.parametrize("number", ["INF", "NaN", "soon", "", "1e400"])
def test_an_experiment_without_usable_numbers_names_none(
    mini_fmus: Minis, tmp_path: Path, number: str
) -> None:
    file = tmp_path / "odd.fmu"
    said = (f'{name}="{number}"' for name in ("startTime", "stopTime", "stepSize", "tolerance"))
    experiment = f"<DefaultExperiment {' '.join(said)}/>".encode()
    with zipfile.ZipFile(mini_fmus["fmi2"]) as source, zipfile.ZipFile(file, "w") as copy:
        for name in source.namelist():
            text = source.read(name)
            if name == "modelDescription.xml":
                text, found = re.subn(rb"<DefaultExperiment[^>]*/>", experiment, text)
                assert found == 1
            copy.writestr(name, text)
    summary = summarise(file)
    assert (summary.start_time, summary.stop_time) == (0.0, None)
    assert (summary.step_size, summary.tolerance) == (None, None)
    assert "it names no stop time: give one" in summary.warnings
    for kind in summary.kinds:
        done = CliRunner().invoke(
            app, ["run", str(file), "--stop", "1", "--step", "0.5", "--kind", kind]
        )
        assert done.exit_code == 0, done.output


def test_a_description_is_printed_as_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    odd = replace(summarise(fmu_path("heat")), description="flow [/min] :100:", name="[red]heat")
    print_summary(odd, every=False)
    printed = capsys.readouterr().out
    assert "flow [/min] :100:" in printed
    assert "[red]heat" in printed


def test_a_description_that_would_grow_without_bounds(tmp_path: Path) -> None:
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    text = (
        f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e0 "lol">{entities}]>'
        '<fmiModelDescription fmiVersion="2.0" modelName="&e11;" guid="x"/>'
    )
    file = tmp_path / "laughs.fmu"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", text)
    with pytest.raises(PlantFileError, match=r"modelDescription\.xml cannot be read"):
        summarise(file)


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x05\x06" + bytes(18)])
def test_no_fmu(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "no.fmu"
    file.write_bytes(content)
    with pytest.raises(PlantFileError, match="not an FMU"):
        summarise(file)
