"""Plants as a user steps them: both FMI versions, isolated or not, names, values, snapshots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fmpy
import numpy as np
import pytest

from fmu_models import (
    Plant,
    PlantClosedError,
    PlantError,
    PlantFileError,
    PlantInputError,
    PlantNameError,
    PlantStepError,
    catalogue,
    fmu_path,
    open_plant,
)
from fmu_models.packing import model_names
from fmu_models.variables import VariableAccess

OPS = [{"op": 50.0 + 15.0 * float(np.sin(k / 6.0))} for k in range(150)]


def inputs_of(name: str) -> list[dict[str, float]]:
    return [{loop.op: row["op"] for loop in catalogue[name].loops} for row in OPS]


@pytest.fixture(params=[True, False], ids=["isolated", "in-process"])
def plant(request: pytest.FixtureRequest) -> Iterator[Plant]:
    with open_plant("example1", isolated=request.param) as opened:
        yield opened


@pytest.mark.parametrize("name", model_names())
def test_fmi2_and_fmi3_isolated_or_not_give_the_same_bits(name: str) -> None:
    results = []
    for version, isolated in ((2, False), (2, True), (3, False), (3, True)):
        with open_plant(fmu_path(name, 2 if version == 2 else 3), isolated=isolated) as plant:
            assert plant.info.fmi_version == f"{version}.0"
            results.append([plant.outputs(), *plant.steps(inputs_of(name))])
    assert all(result == results[0] for result in results[1:])


@pytest.mark.parametrize("name", model_names())
def test_fmpy_runs_it_and_agrees(name: str) -> None:
    """In FMPy's own loop; OP rises between the first and the second sample."""
    model = catalogue[name]
    loop = model.loops[0]
    with open_plant(name, isolated=False) as plant:
        expected = [plant.outputs(), *plant.steps([{loop.op: 50.0}] + [{loop.op: 58.0}] * 39)]
    ramp = [(0.0, 50.0), (0.9 * model.period, 58.0), (1e9, 58.0)]
    result = fmpy.simulate_fmu(
        str(fmu_path(name)),
        stop_time=40 * model.period,
        output_interval=model.period,
        output=[loop.pv, loop.stem],
        input=np.array(ramp, dtype=[("time", "f8"), (loop.op, "f8")]),
    )
    for column in (loop.pv, loop.stem):
        np.testing.assert_array_equal(result[column], [row[column] for row in expected])


def test_batches_are_single_steps(plant: Plant) -> None:
    singles = [plant.step(inputs) for inputs in OPS]
    with open_plant("example1", isolated=False) as other:
        assert other.steps(OPS) == singles


def test_a_batch_longer_than_one_message() -> None:
    inputs = [{"op": 50.0 + (k % 13)} for k in range(2500)]
    with open_plant("example2") as isolated, open_plant("example2", isolated=False) as local:
        assert isolated.steps(inputs) == local.steps(inputs)
        assert isolated.time == local.time == 2500.0


def test_pv_of_the_next_sample_depends_on_this_op(plant: Plant) -> None:
    start = plant.outputs()
    assert plant.time == 0.0
    assert start == {"pv": pytest.approx(50.0), "stem": 50.0, "op_out": 50.0}
    after = plant.step({"op": 70.0})
    assert plant.time == 1.0
    assert after == plant.outputs()
    assert after["stem"] == 66.0
    assert after["pv"] == pytest.approx(50.0 + 0.00277004 * 16.0, abs=0.06)


def test_an_input_keeps_its_value(plant: Plant) -> None:
    plant.step({"op": 70.0, "load": 3.0})
    with open_plant("example1", isolated=False) as other:
        other.step({"op": 70.0, "load": 3.0})
        assert plant.step({}) == other.step({"op": 70.0, "load": 3.0})


def test_time_has_no_drift() -> None:
    with open_plant("flow", period=0.1, isolated=False) as plant:
        plant.steps([{}] * 3000)
        assert plant.time == 300.0


def test_period_is_a_multiple_of_the_models_own_step() -> None:
    with open_plant("example1", parameters={"valve": 0, "noise_std": 0.0}, period=3.0) as slow:
        coarse = slow.step({"op": 60.0})
    with open_plant("example1", parameters={"valve": 0, "noise_std": 0.0}) as fast:
        assert fast.steps([{"op": 60.0}] * 3)[-1] == coarse
    with (
        open_plant("example1", period=0.5, isolated=False) as odd,
        pytest.raises(PlantStepError, match=r"step must be a multiple of 1 s; 0\.5 s was asked"),
    ):
        odd.step({"op": 60.0})


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_period(period: float) -> None:
    with pytest.raises(PlantInputError, match="period must be a positive number"):
        open_plant("example1", period=period)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("isolated", [True, False])
def test_replay_from_a_snapshot_is_bit_exact(version: int, isolated: bool) -> None:
    file = fmu_path("heat", 2 if version == 2 else 3)
    with open_plant(file, isolated=isolated) as plant:
        plant.steps(OPS)
        snapshot, time = plant.snapshot(), plant.time
        first = plant.steps(OPS)
        plant.restore(snapshot)
        assert plant.time == time
        assert plant.steps(OPS) == first
    with open_plant(file, isolated=not isolated, parameters={"seed": 99}) as another:
        another.restore(snapshot)
        assert another.steps(OPS) == first


def test_restore_brings_back_a_plant_that_refused_a_step(plant: Plant) -> None:
    snapshot = plant.snapshot()
    with pytest.raises(PlantStepError, match="slip_jump must not exceed stick_band"):
        plant.step({"slip_jump": 12.0})
    with pytest.raises(PlantClosedError, match="failed before"):
        plant.step({"op": 50.0})
    plant.restore(snapshot)
    assert plant.step({"op": 50.0})["stem"] == 50.0


def test_bytes_that_are_no_snapshot(plant: Plant) -> None:
    with open_plant("example2", isolated=False) as other:
        foreign = other.snapshot()
    own = plant.snapshot()
    for wrong, words in (
        (b"", "these bytes are not a snapshot"),
        (b"x" * 100, "these bytes are not a snapshot"),
        (foreign, "not a snapshot of this model and version"),
        (own[:-1], "not a snapshot of this model and version"),
    ):
        with pytest.raises(PlantInputError, match=words):
            plant.restore(wrong)
    assert plant.step({"op": 50.0})["stem"] == 50.0


def test_snapshot_of_another_period() -> None:
    with open_plant("heat", isolated=False) as plant:
        snapshot = plant.snapshot()
    with (
        open_plant("heat", period=10.0) as slow,
        pytest.raises(PlantInputError, match=r"taken at a period of 5 s.*has 10 s"),
    ):
        slow.restore(snapshot)


def test_unknown_names_come_with_the_nearest_ones(plant: Plant) -> None:
    with pytest.raises(PlantNameError, match="no plant 'exmaple1'; did you mean 'example1'"):
        open_plant("exmaple1")
    with pytest.raises(PlantNameError, match="no plant 'level2'; did you mean 'level'"):
        fmu_path("level2")
    with pytest.raises(PlantNameError, match=r"parameter or input 'stickband'.*'stick_band'"):
        open_plant("example1", parameters={"stickband": 3.0})
    with pytest.raises(PlantNameError, match="no input or tunable parameter 'OP'; did you mean"):
        plant.step({"OP": 50.0})
    with pytest.raises(PlantNameError, match="no input or tunable parameter 'x'; there are: bias"):
        plant.step({"x": 50.0})
    assert plant.time == 0.0


def test_what_cannot_be_set(plant: Plant) -> None:
    with pytest.raises(PlantNameError, match="'seed' is fixed; give it when the plant is opened"):
        plant.step({"seed": 3})
    with pytest.raises(PlantNameError, match=r"'pv' is output .continuous. and cannot be set"):
        plant.step({"pv": 3.0})
    with pytest.raises(PlantNameError, match="'pv' is output"):
        open_plant("example1", parameters={"pv": 3.0})
    assert plant.time == 0.0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_values_that_are_no_numbers(plant: Plant, value: float) -> None:
    with pytest.raises(PlantInputError, match=rf"op = {value} cannot be set.*finite number"):
        plant.step({"op": value})
    with pytest.raises(PlantInputError, match="noise_std"):
        open_plant("example1", parameters={"noise_std": value})
    assert plant.step({"op": 50.0})["stem"] == 50.0  # it goes on


def test_values_that_do_not_fit(plant: Plant) -> None:
    with pytest.raises(PlantInputError, match=r"valve = 1.5 cannot be set; it must be a whole"):
        plant.step({"valve": 1.5})
    with pytest.raises(PlantInputError, match=r"valve = 7 is not within 0 ... 3"):
        plant.step({"valve": 7})
    with pytest.raises(PlantStepError, match=r"noise_std = -1 is not within 0 ... inf"):
        open_plant("example1", parameters={"noise_std": -1.0})
    with pytest.raises(
        PlantInputError, match=r"seed = 1e\+12 cannot be set.*from -2147483648 to 21"
    ):
        open_plant("example1", parameters={"seed": 1e12})
    assert plant.step({"op": 50.0})["stem"] == 50.0


def test_numpy_numbers_are_numbers(plant: Plant) -> None:
    assert plant.step({"op": np.float32(60.0), "valve": np.int64(0)})["stem"] == 60.0
    assert all(type(value) is float for value in plant.outputs().values())


def test_closed_plant(plant: Plant) -> None:
    plant.close()
    plant.close()
    with pytest.raises(PlantClosedError, match="closed; open it again"):
        plant.step({"op": 50.0})
    with pytest.raises(PlantClosedError):
        plant.outputs()


def test_every_plant_error_is_a_plant_error() -> None:
    for kind in (PlantClosedError, PlantFileError, PlantInputError, PlantNameError):
        assert issubclass(kind, PlantError)
    assert str(PlantNameError("said plainly")) == "said plainly"


class _NanFmu:
    """An FMU that puts out NaN: ours check themselves, so this one is made here."""

    component = None

    def __init__(self) -> None:
        self._functions = {"fmi3GetFloat64": self._put_nan}

    def _put_nan(self, _c: object, _r: object, count: int, values: object, _n: int) -> int:
        for i in range(count):
            values[i] = float("nan")  # type: ignore[index]
        return 0


def test_nan_in_an_output_is_an_error() -> None:
    access = VariableAccess(fmpy.read_model_description(str(fmu_path("example1"))))
    with pytest.raises(PlantStepError, match="plant example1: output pv is nan at 7 s"):
        access.read_outputs(_NanFmu(), 7.0)


def test_a_path_may_be_a_string(tmp_path: Path) -> None:
    copy = tmp_path / "my plant.fmu"
    copy.write_bytes(fmu_path("example1").read_bytes())
    with open_plant(str(copy)) as plant:
        assert plant.info.name == "example1"
