"""What FMI 3 has and few tools export: arrays, structural sizes, event mode, early return."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_models import PlantEndedError, PlantInputError, PlantNameError, open_plant, summarise

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
    assert "left out, because a table of numbers has no place for binary data: blob" in warnings
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
