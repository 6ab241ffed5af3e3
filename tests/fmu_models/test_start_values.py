"""Start values that are not numbers: texts of string variables, and words for numbers."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fieldlink.lab.plc import VirtualPlc
from fieldlink.site import load_site
from fmu_models import PlantInputError, PlantNameError, open_plant
from tests.fmu_models import python_fmus
from tests.fmu_models.ssp_files import Minis


@pytest.mark.parametrize("key", ["fmi1-cs", "fmi1-me", "fmi2"])
@pytest.mark.parametrize("isolated", [True, False])
def test_a_text_goes_into_the_fmu(mini_fmus: Minis, key: str, isolated: bool) -> None:
    """The mini counts its batches from the bytes of its label."""
    given = {"label": "Füllung", "tank.inflow[1]": 1.0}
    with open_plant(mini_fmus[key], period=0.5, parameters=given, isolated=isolated) as plant:
        assert "label" in plant.info.parameters
        assert plant.outputs()["batch"] == 8.0  # in UTF-8
        assert plant.step({})["tank.h"] > 0.0
        with pytest.raises(PlantNameError, match="'label' is text, which cannot change during"):
            plant.step({"label": 1.0})


def test_arrays_of_texts_and_words_in_fmi_3(odd: Minis) -> None:
    names = {"names[1]": "abc", "names[2]": "de"}
    with open_plant(odd["plain"], parameters=names | {"mode": "fast", "flag": "true"}) as plant:
        assert plant.outputs()["count"] == 23.0
    with open_plant(odd["plain"]) as plant:
        assert plant.outputs()["count"] == 0.0  # nothing given, nothing set


@pytest.mark.parametrize("tool", python_fmus.TOOLS)
def test_a_text_goes_into_the_fmu_of_another_tool(tool: str, tmp_path: Path) -> None:
    if not python_fmus.is_installed(tool):
        pytest.skip(f"{tool} is not installed: pip install {tool}")
    file = python_fmus.build(tool, tmp_path)
    with open_plant(file, period=0.1, parameters={"label": "seven77"}) as plant:
        assert plant.step({})["level"] == pytest.approx(7.0 * 0.95)


@pytest.mark.parametrize(
    ("given", "kind", "words"),
    [
        ({"names[1]": "a"}, PlantInputError, r"give all its elements, names\[2\] too"),
        ({"names[1]": 3.0}, PlantInputError, "it takes text, give it in quotes"),
        ({"names[1]": "a\0b"}, PlantInputError, "cannot hold the character NUL"),
        ({"names[1]": "a\udc80"}, PlantInputError, "its text is not UTF-8"),
        ({"names[3]": "a"}, PlantNameError, r"no parameter or input 'names\[3\]'; did you mean"),
        ({"key": "00ff"}, PlantNameError, "key is binary data and cannot be set; leave it out"),
        ({"ticks": 1.0}, PlantNameError, "ticks is a clock and cannot be set"),
        ({"gain": "4"}, PlantInputError, "gain = '4' cannot be set; it must be a number$"),
        ({"mode": "quick"}, PlantInputError, "must be a number or one of slow, fast"),
        ({"flag": "yes"}, PlantInputError, "must be a number or one of true, false"),
        ({"gian": "x"}, PlantNameError, "no parameter or input 'gian'; did you mean 'gain'"),
    ],
)
def test_start_values_that_do_not_fit(
    odd: Minis, given: dict[str, float | str], kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        open_plant(odd["plain"], parameters=given, isolated=False)


def test_the_command_line_takes_texts(mini_fmus: Minis, odd: Minis, tmp_path: Path) -> None:
    """Also one with signs of equality, and one that looks like a number; exported, it repeats."""
    out, kept = tmp_path / "out.csv", tmp_path / "run.ssp"
    runner = CliRunner()
    for text, size in (("a=b=c", 5), ("12", 2), ("", 0)):
        file = str(mini_fmus["fmi2"])
        options = ["--set", f"label={text}", "--stop", "1", "--step", "0.5", "--out", str(out)]
        done = runner.invoke(app, ["run", file, *options, "--export", str(kept)])
        assert done.exit_code == 0, done.output
        assert pd.read_csv(out)["batch"].tolist() == [size] * 3
        done = runner.invoke(app, ["run", str(kept), "--out", str(out)])
        assert done.exit_code == 0, done.output
        assert pd.read_csv(out)["batch"].tolist() == [size] * 3
    refused = runner.invoke(app, ["run", str(odd["plain"]), "--set", "key=00"])
    assert "key is binary data and cannot be set" in str(refused.exception)
    swept = ["sweep", str(mini_fmus["fmi2"]), "--set", "label=a,bcd", "--set", "mode=slow,fast"]
    done = runner.invoke(app, [*swept, "--steps", "2", "--step", "0.5", "--out", str(out)])
    assert done.exit_code == 0, done.output
    table = pd.read_csv(out)
    assert table["label"].tolist() == ["a", "a", "bcd", "bcd"]
    assert table["mode"].tolist() == [1.0, 2.0, 1.0, 2.0]
    assert table["batch_last"].tolist() == [1.0, 1.0, 3.0, 3.0]


SITE = """
[site]
name = "texts"
[devices.plc]
link = "fmu"
register_map = "map.csv"
[loops.L]
device = "plc"
op = "L.OP"
pv = "L.PV"
period = 0.5
[loops.L.plant]
fmu = "{fmu}"
controller = "none"
variables = {{ op = "tank.inflow[1]", pv = "batch" }}
parameters = {{ {parameters} }}
"""


def test_a_site_file_takes_texts_and_words(mini_fmus: Minis, tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text(
        "tag,table,address,type\nL.OP,holding,0,float32\nL.PV,holding,2,float32\n"
    )
    file = tmp_path / "site.toml"
    given = 'label = "abcd", mode = "fast", "pump.on" = true, fault = 0'
    file.write_text(SITE.format(fmu=mini_fmus["fmi2"], parameters=given))
    with VirtualPlc(load_site(file), "plc") as plc:
        plc.scan()
        assert plc.truth("L").pv[0] == 4.0
    file.write_text(SITE.format(fmu=mini_fmus["fmi2"], parameters='mode = "quick"'))
    with pytest.raises(Exception, match="loop L: plant mini: mode = 'quick' cannot be set"):
        VirtualPlc(load_site(file), "plc")
    file.write_text(SITE.format(fmu=mini_fmus["fmi2"], parameters="mode = [1]"))
    with pytest.raises(Exception, match="give a finite number, true, false, or a"):
        load_site(file)
