"""Running an FMU as a user does: maps, inputs, units, a controller, states, pacing, tables."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fieldlink.lab.fmu import FmuError, FmuMap, RunSettings, load_map, run_fmu
from fieldlink.lab.fmu.inputs import read_inputs
from fmu_models import PlantInputError, fmu_path, open_plant, summarise

Minis = dict[str, Path]

MAP = """
period = 0.5
[inputs.QI]
variable = "tank.inflow[1]"
unit = "m3/h"
[outputs.LT]
variable = "tank.h"
unit = "mm"
[outputs.DLT]
variable = "der(tank.h)"
"""


def command(*arguments: object) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)])


def test_without_a_map_it_is_the_default_experiment(tmp_path: Path) -> None:
    out = tmp_path / "heat.csv"
    done = command("run", "heat", "--out", out)
    assert done.exit_code == 0, done.output
    table = pd.read_csv(out)
    assert table["time"].tolist() == [5.0 * k for k in range(1001)]
    with open_plant("heat") as plant:
        rows = [plant.outputs(), *plant.steps([{}] * 1000)]
    np.testing.assert_allclose(table["pv"], [row["pv"] for row in rows], rtol=1e-12)
    assert "nothing drives keep their start values: op, load, sp" in done.output


def test_map_inputs_units_and_parquet(mini_fmus: Minis, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP)
    (tmp_path / "in.csv").write_text("time;QI\n0;7200\n2;3600\n")
    out, picture = tmp_path / "out.parquet", tmp_path / "out.png"
    done = command(
        "run", mini_fmus["fmi2"], "--map", tmp_path / "map.toml", "--inputs", tmp_path / "in.csv",
        "--stop", 4, "--kind", "model exchange", "--out", out, "--plot", picture,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    table = pd.read_parquet(out)
    t = table["time"].to_numpy()
    assert t.tolist() == [0.5 * k for k in range(9)]
    assert table["QI"].tolist() == [7200.0] * 4 + [3600.0] * 5
    filling = 2.0 * (1.0 - np.exp(-np.minimum(t, 2.0)))
    level = np.where(t <= 2.0, filling, 1.0 + (filling[4] - 1.0) * np.exp(-(t - 2.0)))
    np.testing.assert_allclose(table["LT"], 1000.0 * level, atol=0.2)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("isolated", [True, False])
def test_controller_of_a_map_is_the_controller_inside(tmp_path: Path, isolated: bool) -> None:
    """The same PI, once in our loop and once in the FMU."""
    file = tmp_path / "map.toml"
    file.write_text(
        '[inputs.OP]\nvariable = "op"\nvalue = 40.0\n[outputs.PV]\nvariable = "pv"\n'
        '[outputs.STEM]\nvariable = "stem"\n[controller]\nop = "OP"\npv = "PV"\n'
        "gain = 0.8\nintegral_time = 10.0\nsetpoint = [[0.0, 50.0], [100.0, 55.0]]\n"
    )
    fmu = summarise(fmu_path("example1"))
    result = run_fmu(fmu, load_map(file, fmu), RunSettings(stop=300.0, isolated=isolated))
    sp = np.where(np.arange(300) < 100, 50.0, 55.0)
    with open_plant("example1", parameters={"op": 40.0, "controller": 1}) as plant:
        inside = plant.run(300, {"sp": sp})
    np.testing.assert_allclose(result.columns["PV"][1:], inside["pv"], rtol=1e-9)
    np.testing.assert_allclose(result.columns["OP"][:-1], inside["op_out"], rtol=1e-9)
    assert result.columns["SP"][[0, 99, 100, 300]].tolist() == [50.0, 50.0, 55.0, 55.0]


def test_state_is_saved_and_taken_up_again(tmp_path: Path) -> None:
    whole, rest = tmp_path / "whole.csv", tmp_path / "rest.csv"
    state = tmp_path / "state"
    options = ("--set", "controller=1", "--set", "op_start=40", "--stop", 200)
    assert command("run", "flow", *options, "--out", whole).exit_code == 0
    saved = command("run", "flow", *options, "--save-state", state, "--snapshot-at", 77)
    assert saved.exit_code == 0, saved.output
    again = command("run", "flow", "--load-state", state, "--stop", 200, "--out", rest)
    assert again.exit_code == 0, again.output
    first, second = pd.read_csv(whole), pd.read_csv(rest)
    assert second["time"].iloc[0] == 77.0
    for column in ("pv", "stem", "op_out"):
        assert second[column].tolist() == first[column].iloc[77:].tolist()
    other = command("run", "level", "--load-state", state)
    assert isinstance(other.exception, FmuError)
    assert "the state is of another FMU" in str(other.exception)
    (tmp_path / "text").write_text("hello")
    text = command("run", "level", "--load-state", tmp_path / "text")
    assert "this file was not written by --save-state" in str(text.exception)


def test_paced_run_takes_its_time_and_does_not_drift() -> None:
    fmu = summarise(fmu_path("flow"))
    result = run_fmu(fmu, FmuMap(), RunSettings(stop=40.0, speed=100.0))
    assert result.seconds >= 0.4
    assert result.time[-1] == 40.0
    fast = run_fmu(fmu, FmuMap(), RunSettings(stop=40.0))
    np.testing.assert_array_equal(result.columns["pv"], fast.columns["pv"])


def test_failure_keeps_what_was_recorded(mini_fmus: Minis, tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text("time,tank.inflow[1]\n0,1\n")
    out = tmp_path / "out.csv"
    done = command(
        "run", mini_fmus["fmi2"], "--stop", 100, "--step", 2, "--out", out, "--inputs",
        tmp_path / "in.csv",
    )  # fmt: skip
    assert isinstance(done.exception, FmuError)
    words = "it ended early, at 0 s: plant mini: the step from 0 s by 2 s failed: the FMU discarded"
    assert words in str(done.exception)
    assert len(pd.read_csv(out)) == 1


@pytest.mark.parametrize("speed", [None, 1000.0])
def test_interruption_keeps_what_was_recorded(speed: float | None) -> None:
    def interrupt(moment: float) -> None:
        if moment >= 600.0:
            raise KeyboardInterrupt

    fmu = summarise(fmu_path("flow"))
    result = run_fmu(fmu, FmuMap(), RunSettings(stop=900.0, speed=speed), interrupt)
    assert result.failure == "it was interrupted"
    assert 600.0 <= result.time[-1] <= 900.0
    whole = run_fmu(fmu, FmuMap(), RunSettings(stop=900.0))
    rows = result.time.size
    np.testing.assert_array_equal(result.columns["pv"], whole.columns["pv"][:rows])


def test_watched_variables_and_booleans(mini_fmus: Minis) -> None:
    fmu = summarise(mini_fmus["fmi1-me"])
    settings = RunSettings(
        stop=5.0, step=0.5, start_values={"tank.inflow[1]": 3.0}, watch=("der(tank.h)",)
    )
    result = run_fmu(fmu, FmuMap(), settings)
    assert set(result.columns) == {"tank.h", "alarm", "batch", "der(tank.h)"}
    assert result.columns["alarm"][[0, -1]].tolist() == [0.0, 1.0]
    level, slope = result.columns["tank.h"], result.columns["der(tank.h)"]
    np.testing.assert_allclose(level + slope, 3.0, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = [", "the map is not TOML"),
        ("speed = 2", "speed: Extra inputs are not permitted; got 2"),
        (
            '[inputs.A]\nvariable = "tank.inflow"\n',
            r"does not exist; did you mean 'tank\.inflow\[1",
        ),
        ('[inputs.A]\nvariable = "tank.h"\n', r"is output and cannot be written"),
        ('[outputs.A]\nvariable = "tank.hh"\n', r"outputs\.A: .*did you mean 'tank\.h'"),
        ("[parameters]\nfalt = 1.0\n", r"'falt' does not exist or cannot.*did you mean 'fault'"),
        ('[inputs.A]\nvariable = "mode"\nvalue = nan\n', r"inputs\.A\.value: .*finite"),
        (
            '[inputs.A]\nvariable = "mode"\n[inputs.B]\nvariable = "mode"\n',
            "B and A both write mode",
        ),
        (
            '[inputs.A]\nvariable = "mode"\n[outputs.A]\nvariable = "tank.h"\n',
            "A: a tag is an input or an output, not both",
        ),
        (
            '[controller]\nop = "A"\npv = "B"\ngain = 1\nintegral_time = 1\nsetpoint = [[0, 1]]\n',
            r"controller\.op 'A' is not a tag of \[inputs\]",
        ),
        ("period = 0", "period: Input should be greater than 0; got 0"),
    ],
)
def test_maps_that_do_not_fit(mini_fmus: Minis, tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "map.toml"
    file.write_text(text)
    with pytest.raises(FmuError, match=words):
        load_map(file, summarise(mini_fmus["fmi2"]))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,op\n0,1\n", r"no column 'time' .* is it 't'\? Call it time, and give seconds"),
        ("time,opp\n0,1\n", r"column 'opp' is not an input; did you mean 'op'"),
        ("time,op\n0,1\n1,x\n", r"row 3, column 'op': 'x' is not a finite number"),
        ("time,op\n0,1\n1,inf\n", r"row 3, column 'op'"),
        ("time,op\n0,1\n-1,2\n", "time must not decrease; row 3 has -1 after 0; sort the rows"),
        ("time,op\n0,1,5\n", "row 2 has 3 cells, the header has 2"),
        ("time,op\n0,NaN\n", "row 2, column 'op': 'NaN' is not a finite number"),
        ("time,op,op\n0,1,2\n", "two columns 'op'"),
        ("time;op\n0;998\n1;1,005\n", "column 'op': '1,005' may be a decimal comma or grouped"),
        ("time,op\n0,5 %\n1,6 %\n", "row 2, column 'op': '5 %' is not a finite number"),
        ("time,op\n0,Bad\n1,6\n", "row 2, column 'op': 'Bad' is not a finite number"),
        ("time,op\n2026-02-01 10:00,5\n", r"'2026-02-01 10:00' is .*; give seconds of the run"),
        ("time,op\n", "no row below the header"),
        ("", "it is empty"),
    ],
)
def test_inputs_that_cannot_be_used(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "in.csv"
    file.write_text(text)
    with pytest.raises(FmuError, match=words):
        read_inputs(file, ("op", "load"))


def test_inputs_as_a_spreadsheet_writes_them(tmp_path: Path) -> None:
    """A byte order mark, semicolons, decimal commas; of two rows of one moment the last holds."""
    file = tmp_path / "in.csv"
    file.write_bytes("\ufefftime;op\r\n0,0;1,5\r\n0,5;2,5\r\n0,5;-3e0\r\n".encode())
    at = read_inputs(file, ("op",)).at(np.array([0.0, 0.4, 0.5, 9.0]))
    assert at["op"].tolist() == [1.5, 1.5, -3.0, -3.0]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("time;op\n0;1,005\n0,5;1,010\n", [1.005, 1.01]),
        ("time;op\n0;1,005\n0.5;2,010\n", [1005.0, 2010.0]),
        ("time;op\n0;1.005,5\n0,5;998,0\n", [1005.5, 998.0]),
        ("time,op\n0,1.005\n1,2\n", [1.005, 2.0]),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_numbers_of_inputs_are_read_as_those_of_recordings(
    tmp_path: Path, text: str, values: list[float], encoding: str
) -> None:
    file = tmp_path / "in.csv"
    file.write_bytes(text.replace("op", "Öffnung").encode(encoding))
    assert read_inputs(file, ("Öffnung",)).columns["Öffnung"].tolist() == values


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (RunSettings(stop=float("nan")), "must be a finite second; got nan"),
        (RunSettings(stop=10.0, step=0.0), "period must be a positive number"),
        (RunSettings(stop=10.0, step=float("nan")), "period must be a positive number"),
        (RunSettings(stop=0.0), "the stop time 0 s must lie after the start at 0 s"),
        (RunSettings(stop=-1.0), "give a later one with --stop"),
        (RunSettings(stop=10.0, save=Path("x"), save_at=11.0), "cannot be saved at 11 s"),
    ],
)
def test_experiments_that_make_no_sense(settings: RunSettings, words: str) -> None:
    with pytest.raises((FmuError, PlantInputError), match=words):
        run_fmu(summarise(fmu_path("flow")), FmuMap(), settings)


def test_input_without_start_value_that_nothing_drives(mini_fmus: Minis, tmp_path: Path) -> None:
    import zipfile

    file = tmp_path / "needs.fmu"
    with zipfile.ZipFile(mini_fmus["fmi1-cs"]) as source, zipfile.ZipFile(file, "w") as copy:
        for name in source.namelist():
            content = source.read(name)
            if name.endswith(".xml"):
                content = content.replace(b'<Real start="0" unit="m3/s"/>', b"<Real/>")
            copy.writestr(name, content)
    fmu = summarise(file)
    assert "input tank.inflow[1] has no start value: it needs one" in fmu.warnings
    with pytest.raises(
        FmuError, match=r"input tank\.inflow\[1\] has no start value and nothing dr"
    ):
        run_fmu(fmu, FmuMap(), RunSettings(stop=1.0))
    driven = run_fmu(fmu, FmuMap(), RunSettings(stop=1.0, start_values={"tank.inflow[1]": 1.0}))
    assert driven.failure is None


def test_start_values_by_name(mini_fmus: Minis, tmp_path: Path) -> None:
    file, out = mini_fmus["fmi2"], tmp_path / "out.csv"
    options = ("--stop", 2, "--step", 0.5, "--set", "tank.inflow[1]=1", "--out", out)
    for chosen, factor in (("mode=fast", 2.0), ("pump.on=false", 0.0), ("mode=1", 1.0)):
        assert command("run", file, *options, "--set", chosen).exit_code == 0
        level = pd.read_csv(out)["tank.h"]
        np.testing.assert_allclose(level, factor * (1.0 - np.exp(-0.5 * np.arange(5))), atol=2e-3)
    refused = command("run", file, *options, "--set", "mode=quick")
    assert "or one of slow, fast" in " ".join(refused.output.replace("│", "").split())
    with pytest.raises(PlantInputError, match=r"mode = 7 .* must be one of 1 \(slow\), 2 \(fast\)"):
        open_plant(file, period=1.0, parameters={"mode": 7})


def test_values_outside_of_their_range_are_named(mini_fmus: Minis, tmp_path: Path) -> None:
    file = tmp_path / "ranged.fmu"
    with zipfile.ZipFile(mini_fmus["fmi2"]) as old, zipfile.ZipFile(file, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'unit="m3/s"', b'unit="m3/s" min="0" max="1"')
            new.writestr(name, content)
    (tmp_path / "in.csv").write_text("time,tank.inflow[1]\n0,0.5\n1,40\n")
    options = ("--stop", 2, "--step", 0.5)
    note = "outside of the range that the FMU names: tank.inflow[1] = 40 (range 0 to 1)"
    for given, noted in (
        (("--set", "tank.inflow[1]=40"), True),
        (("--set", "tank.inflow[1]=0.4"), False),
        (("--inputs", tmp_path / "in.csv"), True),
    ):
        done = command("run", file, *options, *given)
        assert done.exit_code == 0, done.output
        assert (note in " ".join(done.output.split())) == noted


def test_options_that_are_refused() -> None:
    assert "is not NAME=VALUE" in command("run", "flow", "--set", "op").output
    assert "--save-state" in command("run", "flow", "--snapshot-at", 3).output
    unknown = command("run", "flow", "--set", "opp=3")
    assert "did you mean 'op'" in str(unknown.exception)
    ending = command("run", "flow", "--stop", 5, "--out", "table.txt")
    assert "ends in .csv or .parquet" in str(ending.exception)
