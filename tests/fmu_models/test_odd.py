"""What FMI 3 has and few tools export: arrays, structural sizes, event mode, early return."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy
import fmpy.simulation
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fmu_models import (
    PlantEndedError,
    PlantError,
    PlantInputError,
    PlantNameError,
    open_plant,
    summarise,
)

Odd = dict[str, Path]


def exact(moments: list[float]) -> list[float]:
    """x of odd3.c without input: back to 1 every 0.7 s, another target below 0.5."""
    values = []
    for moment in moments:
        since = (moment + 1e-9) % 0.7 - 1e-9
        below = since - np.log(2.0)
        values.append(0.3 + 0.2 * np.exp(-below) if below > 0.0 else np.exp(-since))
    return values


@pytest.mark.parametrize("isolated", [True, False])
@pytest.mark.parametrize("key", ["plain", "events"])
@pytest.mark.parametrize(("kind", "tolerance"), [("co-simulation", 1e-9), ("model exchange", 2e-5)])
def test_events_between_samples(
    odd: Odd, key: str, kind: str, tolerance: float, isolated: bool
) -> None:
    with open_plant(odd[key], kind=kind, isolated=isolated) as plant:
        table = plant.run(20, {})
    moments = [0.25 * k for k in range(1, 21)]
    np.testing.assert_allclose(table["x"], exact(moments), rtol=tolerance)
    assert table["count"].tolist() == [int((t + 1e-9) / 0.7) for t in moments]
    np.testing.assert_allclose(table["time"], moments, atol=1e-9)


@pytest.mark.parametrize("isolated", [True, False])
def test_arrays_by_element(odd: Odd, isolated: bool) -> None:
    with open_plant(odd["plain"], watch=["m"], isolated=isolated) as plant:
        assert plant.info.inputs == ("u[1]", "u[2]", "u[3]", "flag", "mode")
        outputs = plant.step({"u[2]": 5.0})
        assert [outputs[f"y[{k}]"] for k in (1, 2, 3)] == [0.0, 10.0, 0.0]
        table = plant.run(2, {"u[3]": np.array([1.0, 2.0])})  # u[2] keeps its value
        assert table["y[2]"].tolist() == [10.0, 10.0]
        assert table["y[3]"].tolist() == [2.0, 4.0]
        assert plant.step({"u[1]": 3.0})["y[3]"] == 4.0
        np.testing.assert_allclose(table["m[2,1]"], 4.0 * table["x"])
        with pytest.raises(PlantNameError, match=r"no input or tunable parameter 'u\[4\]'"):
            plant.step({"u[4]": 1.0})


@pytest.mark.parametrize("kind", ["co-simulation", "model exchange"])
def test_a_structural_parameter_decides_the_size(odd: Odd, kind: str) -> None:
    with open_plant(odd["plain"], kind=kind, parameters={"n": 5, "u[5]": 7.0}) as plant:
        assert plant.outputs()["y[5]"] == 14.0
        assert plant.run(3, {"u[4]": 2.0})["y[4]"].tolist() == [4.0] * 3
    with pytest.raises(PlantInputError, match=r"its size is n = 2\.5; it must be a whole number"):
        open_plant(odd["plain"], parameters={"n": 2.5})
    with pytest.raises(PlantInputError, match="the limit is 1000000"):
        open_plant(odd["plain"], parameters={"n": 1e9})


def test_a_snapshot_brings_back_the_elements_that_are_not_written(odd: Odd) -> None:
    with open_plant(odd["events"]) as plant:
        plant.step({"u[1]": 1.0, "u[2]": 2.0})
        snapshot = plant.snapshot()
        plant.step({"u[2]": 9.0})
        plant.restore(snapshot)
        assert plant.step({"u[3]": 3.0})["y[2]"] == 4.0


@pytest.mark.parametrize(("key", "kind"), [("plain", "co-simulation"), ("events", "co-simulation")])
def test_the_moment_at_which_it_ends_is_a_row(odd: Odd, key: str, kind: str) -> None:
    kept = []
    with (
        open_plant(odd[key], kind=kind, parameters={"stop_at": 0.9}) as plant,
        pytest.raises(PlantEndedError, match=r"ended the simulation at 0\.9 s"),
    ):
        kept.extend(plant.run_pieces(20, {}))
    moments = np.concatenate([piece.time for piece in kept])
    np.testing.assert_allclose(moments, [0.25, 0.5, 0.75, 0.9])
    x = np.concatenate([piece.columns["x"] for piece in kept])
    np.testing.assert_allclose(x, exact([0.25, 0.5, 0.75, 0.9]), rtol=1e-9)


def test_what_is_left_out_is_named_with_the_reason(odd: Odd) -> None:
    warnings = summarise(odd["plain"]).warnings
    assert (
        "left out, because a table of numbers has no place for binary data: blob, key" in warnings
    )
    assert "texts that can be given at the start: names" in warnings
    assert any(w.startswith("left out, because a clock has ticks") for w in warnings)
    assert not any(w.startswith("not quite") for w in warnings)
    for name, why in (("blob", "a table of numbers"), ("ticks", "a clock has ticks")):
        with pytest.raises(PlantNameError, match=f"{name} cannot be recorded, because {why}"):
            open_plant(odd["plain"], watch=[name])


def test_whole_numbers_that_do_not_fit_are_refused_in_words(odd: Odd) -> None:
    with open_plant(odd["plain"]) as plant:
        with pytest.raises(PlantInputError, match=r"flag = 2 cannot be set; it must be 0 or 1$"):
            plant.step({"flag": np.float64(2.0)})
        words = "a whole number from -9223372036854775808 to 9223372036854775807"
        with pytest.raises(
            PlantInputError, match=rf"mode = 1\.5 cannot be set; it must be {words}$"
        ):
            plant.step({"mode": 1.5})


@pytest.mark.parametrize("isolated", [True, False])
def test_outputs_between_the_ends_of_a_step_are_those_that_fmpy_sees(
    odd: Odd, tmp_path: Path, isolated: bool
) -> None:
    with open_plant(odd["events"], period=1.0, intermediate=True, isolated=isolated) as plant:
        plant.run(3, {})
        first = plant.take_intermediate()
        plant.step({})
        second = plant.take_intermediate()
        assert plant.take_intermediate().time.size == 0
    moments, x = _between_the_steps_by_fmpy(odd["events"], tmp_path, stop=4.0)
    np.testing.assert_array_equal(np.concatenate([first.time, second.time]), moments)
    np.testing.assert_array_equal(np.concatenate([first.columns["x"], second.columns["x"]]), x)
    crossing = np.log(2.0)  # where x passes 0.5, between two steps
    assert first.columns["x"][0] == 0.5
    np.testing.assert_allclose(first.time[:2], [crossing, 0.7], rtol=1e-12)
    with open_plant(odd["events"]) as plant, pytest.raises(PlantInputError, match="are not kept"):
        plant.take_intermediate()
    with pytest.raises(PlantInputError, match="offers no outputs between the ends of a step"):
        open_plant(odd["plain"], kind="model exchange", intermediate=True)


def _between_the_steps_by_fmpy(
    file: Path, folder: Path, stop: float
) -> tuple[list[float], list[float]]:
    """Return moments and x of the callbacks under ``fmpy.simulate_fmu``, at steps of 1 s."""
    moments: list[float] = []
    values: list[float] = []
    description = fmpy.read_model_description(str(file))
    reference = next(v.valueReference for v in description.modelVariables if v.name == "x")

    def listen(_e: object, time: float, *_flags: object) -> None:
        moments.append(time)
        values.extend(fmu.getFloat64([reference]))

    unzipped = fmpy.extract(str(file), str(folder))
    fmu = fmpy.simulation.instantiate_fmu(
        unzipped, description, "CoSimulation", early_return_allowed=True, event_mode_used=True,
        intermediate_update=listen, required_intermediate_variables=[reference],
    )  # fmt: skip
    fmpy.simulate_fmu(
        unzipped, model_description=description, fmi_type="CoSimulation", stop_time=stop,
        output_interval=1.0, early_return_allowed=True, use_event_mode=True, fmu_instance=fmu,
    )  # fmt: skip
    fmu.freeInstance()
    return moments, values


def test_the_outputs_between_the_steps_go_into_a_file(odd: Odd, tmp_path: Path) -> None:
    between = tmp_path / "between.csv"
    done = CliRunner().invoke(
        app,
        ["run", str(odd["plain"]), "--step", "1", "--stop", "3", "--intermediate", str(between)],
    )
    assert done.exit_code == 0, done.output
    table = pd.read_csv(between)
    assert table["time"].is_monotonic_increasing
    np.testing.assert_allclose(table["x"][0], 0.5, rtol=1e-12)
    assert set(table["time"]) >= {1.0, 2.0, 3.0}


@pytest.mark.parametrize("step", ["-1", "0", "NaN", "1,0"])
def test_a_step_that_is_none_is_not_named(odd: Odd, tmp_path: Path, step: str) -> None:
    file = tmp_path / "step.fmu"
    with zipfile.ZipFile(odd["plain"]) as old, zipfile.ZipFile(file, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, content.replace(b'stepSize="0.25"', f'stepSize="{step}"'.encode()))
    assert summarise(file).step_size is None
    with pytest.raises(PlantError, match="names no step size; give the period"):
        open_plant(file)
