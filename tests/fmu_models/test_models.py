"""The C models against independent computations: SciPy, analytic steps, the shared valve model."""

from __future__ import annotations

import fmpy
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, signal

from compensator import OpLimits, PiController, PiSettings
from fmu_models import catalogue, fmu_path, open_plant
from fmu_models.packing import model_names
from fmu_models.tables import SOURCES, read_model
from loop_model import ValveModel

Array = NDArray[np.float64]
ONE_LOOP = [name for name in model_names() if len(catalogue[name].loops) == 1]
LAGS = {"example1": (4.0, 6.0, 2.0), "example2": (10.0, 5.0, 1.0)}


def run(name: str, op: Array, period: float | None = None, **parameters: float) -> dict[str, Array]:
    """Step a plant through ``op``; element 0 of every output is the value at the start."""
    with open_plant(name, parameters=parameters, period=period, isolated=False) as plant:
        rows = [plant.outputs(), *plant.steps([{"op": value} for value in op])]
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def wandering_op(samples: int, seed: int = 3) -> Array:
    """An OP with ramps, reversals, pauses and noise, within 20 ... 80 %."""
    rng = np.random.default_rng(seed)
    walk = 50.0 + 25.0 * np.sin(np.arange(samples) / 17.0) + np.cumsum(rng.normal(0, 0.4, samples))
    walk[samples // 3 : samples // 3 + 20] = walk[samples // 3]
    return np.clip(walk, 20.0, 80.0)


@pytest.mark.parametrize("name", ["example1", "example2"])
def test_example_is_its_transfer_function_sampled(name: str) -> None:
    denominator = np.poly1d([1.0])
    for lag in LAGS[name]:
        denominator *= np.poly1d([lag, 1.0])
    b, a, _ = signal.cont2discrete(([1.0], denominator.coeffs), 1.0, method="zoh")
    process = catalogue[name].process
    assert process is not None
    np.testing.assert_allclose(process.a, a[1:], rtol=1e-12)
    np.testing.assert_allclose(process.b, b[0, 1:], rtol=1e-9)
    assert process.gain == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "printed_a", "printed_b"),
    [
        ("example1", ("-2.232", "1.645", "-.3998"), ("0.00277", "0.00884", "0.001752")),
        ("example2", ("-2.091", "1.375", "-.2725"), ("0.002445", "0.007181", "0.001278")),
    ],
)
def test_example_rounds_to_the_papers_coefficients(
    name: str, printed_a: tuple[str, ...], printed_b: tuple[str, ...]
) -> None:
    process = catalogue[name].process
    assert process is not None
    for exact, printed in zip((*process.a, *process.b), (*printed_a, *printed_b), strict=True):
        digits = len(printed.split(".")[1])
        assert round(exact, digits) == float(printed)


@pytest.mark.parametrize("name", ["example1", "example2"])
def test_example_against_scipy(name: str) -> None:
    op = wandering_op(600)
    outputs = run(name, op, noise_std=0.0, load=1.5)
    model = catalogue[name]
    assert model.process is not None
    stem = model.valve.simulate(op, 50.0)
    np.testing.assert_array_equal(outputs["stem"][1:], stem)
    transfer = (model.process.b, [1.0, *model.process.a], 1.0)
    _, deviation = signal.dlsim(transfer, np.append(stem, stem[-1]) - 50.0)
    np.testing.assert_allclose(outputs["pv"], 51.5 + deviation[:, 0], atol=1e-9)


@pytest.mark.parametrize("name", ["example1", "example2"])
def test_noise_of_the_examples_is_white_equation_noise(name: str) -> None:
    model = catalogue[name]
    assert model.process is not None
    op = np.full(6000, 50.0)
    difference = run(name, op)["pv"] - run(name, op, noise_std=0.0)["pv"]
    v = signal.lfilter([1.0, *model.process.a], [1.0], difference)[1:]
    assert v.std() == pytest.approx(model.noise_std, rel=0.05)
    assert abs(v.mean()) < 4 * model.noise_std / np.sqrt(v.size)
    correlation = np.correlate(v, v, "full")[v.size : v.size + 20] / np.dot(v, v)
    assert np.abs(correlation).max() < 4 / np.sqrt(v.size)


def test_output_noise_and_bias_are_added_to_pv() -> None:
    op = np.full(4000, 50.0)
    pv = run("example1", op, noise_std=0.0, output_noise_std=0.5, bias=-20.0)["pv"]
    assert pv.mean() == pytest.approx(30.0, abs=0.04)
    assert pv.std() == pytest.approx(0.5, rel=0.05)


def test_flow_is_its_valve_equation_behind_a_lag() -> None:
    op = wandering_op(300)
    outputs = run("flow", op, noise_std=0.0, load=10.0)
    f = catalogue["flow"].valve.simulate(op, 50.0) / 100.0
    steady = 100.0 * np.sqrt(1.1) * f / np.sqrt(0.5 + 0.5 * f**2)
    pole = np.exp(-1.0 / 2.0)
    start = 100.0 * np.sqrt(1.1) * 0.5 / np.sqrt(0.5 + 0.5 * 0.25)
    expected, _ = signal.lfilter([1.0 - pole], [1.0, -pole], steady, zi=[pole * start])
    np.testing.assert_allclose(outputs["pv"], [start, *expected], rtol=1e-12)


def test_gain_of_flow_falls_as_the_valve_opens() -> None:
    def gain(op: float) -> float:
        pv = run("flow", np.full(60, op + 1.0), valve=0, noise_std=0.0, op_start=op)["pv"]
        return float(pv[-1] - pv[0])

    assert gain(20.0) > 1.5 * gain(80.0) > 0.0


def test_level_integrates_the_imbalance_and_stays_in_the_tank() -> None:
    op = wandering_op(300)
    outputs = run("level", op, noise_std=0.0)
    stem = catalogue["level"].valve.simulate(op, 50.0)
    expected = 50.0 + np.cumsum(stem - 50.0) / 200.0
    np.testing.assert_allclose(outputs["pv"][1:], expected, atol=1e-9)
    assert run("level", np.full(400, 100.0), noise_std=0.0)["pv"][-1] == 100.0
    assert run("level", np.full(400, 0.0), noise_std=0.0)["pv"][-1] == 0.0


@pytest.mark.parametrize("lags", [(60.0, 15.0), (30.0, 30.0)])
def test_heat_is_two_lags_and_a_dead_time(lags: tuple[float, float]) -> None:
    op = wandering_op(300)
    outputs = run(
        "heat", op, noise_std=0.0, time_constant1=lags[0], time_constant2=lags[1], load=-2.0
    )
    stem = catalogue["heat"].valve.simulate(op, 50.0) - 50.0
    denominator = np.polymul([lags[0], 1.0], [lags[1], 1.0])
    b, a, _ = signal.cont2discrete(([0.8], denominator), 5.0, method="zoh")
    delayed = np.concatenate([np.zeros(4), stem, [0.0]])[: stem.size + 1]
    expected = 20.0 + 0.8 * 48.0 + signal.lfilter(b[0], a, delayed)
    np.testing.assert_allclose(outputs["pv"], expected, atol=1e-9)


def test_pressure_against_an_integrator_with_error_control() -> None:
    op = np.array([50.0, 70.0, 70.0, 30.0, 30.0, 30.0])
    outputs = run("pressure", op, valve=0, noise_std=0.0, load=20.0)
    pressure = 10.0 * 0.25 / (0.25 + (0.6 * 1.2) ** 2)
    expected = [pressure]
    for value in op:
        f = value / 100.0
        solution = integrate.solve_ivp(
            lambda _, y, f=f: (f * np.sqrt(10.0 - y) - 0.6 * 1.2 * np.sqrt(y)) / 2.0,
            (0.0, 1.0),
            [expected[-1]],
            rtol=1e-10,
            atol=1e-12,
        )
        expected.append(solution.y[0, -1])
    np.testing.assert_allclose(outputs["pv"], expected, rtol=1e-8)


@pytest.mark.parametrize("name", ["example1", "example2", "level", "heat"])
def test_catalogue_process_predicts_the_plant(name: str) -> None:
    model = catalogue[name]
    assert model.process is not None
    op = wandering_op(200)
    pv = run(name, op, noise_std=0.0)["pv"]
    stem = model.valve.simulate(op, 50.0)
    shifted = np.concatenate([[50.0], stem])  # the catalogue's PV at 0 rests
    pv0 = [50.0] if model.process.is_integrating else []
    lead = model.process.simulate(np.append(shifted, stem[-1]), pv0=pv0)
    np.testing.assert_allclose(pv, lead[1 : pv.size + 1], atol=1e-6)


@pytest.mark.parametrize("name", model_names())
def test_catalogue_agrees_with_the_source(name: str) -> None:
    model = catalogue[name]
    source = read_model(SOURCES / f"{name}.c")
    start = {variable.name: variable.start for variable in source.variables}
    assert model.period == source.default_step
    assert model.noise_std == pytest.approx(start["noise_std"], rel=1e-12)
    for loop in model.loops:
        assert model.valve == ValveModel(start[loop.stick_band], start[loop.slip_jump])
        assert {getattr(loop, role) for role in loop.__slots__} <= set(start)
        assert f"{loop.op}_start" in start


@pytest.mark.parametrize("name", model_names())
def test_every_variable_has_a_description_and_every_signal_a_unit(name: str) -> None:
    for version in (2, 3):
        description = fmpy.read_model_description(str(fmu_path(name, 2 if version == 2 else 3)))
        for variable in description.modelVariables:
            assert variable.description, variable.name
            if variable.causality in ("input", "output"):
                assert variable.unit, variable.name


@pytest.mark.parametrize("name", ONE_LOOP)
def test_plant_starts_at_rest_at_any_op(name: str) -> None:
    for op in (20.0, 50.0, 80.0):
        outputs = run(name, np.full(50, op), noise_std=0.0, op_start=op)
        np.testing.assert_allclose(outputs["stem"], op, atol=1e-9)
        np.testing.assert_allclose(outputs["pv"], outputs["pv"][0], atol=1e-9)


@pytest.mark.parametrize("name", ONE_LOOP)
def test_op_given_at_the_start_is_where_the_plant_rests(name: str) -> None:
    with open_plant(name, parameters={"op": 30.0, "noise_std": 0.0}, isolated=False) as plant:
        start = plant.outputs()
        assert start["stem"] == pytest.approx(30.0, abs=1e-9)
        assert plant.step({})["pv"] == pytest.approx(start["pv"], abs=1e-9)


@pytest.mark.parametrize("name", ONE_LOOP)
def test_healthy_valve_follows_op(name: str) -> None:
    op = wandering_op(40)
    outputs = run(name, op, period=5.0, valve=0)
    np.testing.assert_allclose(outputs["stem"][1:], op, atol=1e-6)
    np.testing.assert_array_equal(outputs["op_out"][1:], op)


@pytest.mark.parametrize("name", ONE_LOOP)
def test_noise_is_decided_by_the_seed_alone(name: str) -> None:
    op = np.full(30, 50.0)
    first, again, other = (run(name, op, seed=seed)["pv"] for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert np.all(first[1:] != other[1:])


@pytest.mark.parametrize("name", ONE_LOOP)
def test_load_moves_pv(name: str) -> None:
    op = np.full(80, 50.0)
    quiet, loaded = (run(name, op, valve=0, noise_std=0.0, load=load)["pv"] for load in (0.0, 5.0))
    with open_plant(name, parameters={"valve": 0, "noise_std": 0.0}, isolated=False) as plant:
        rows = plant.steps([{"load": 5.0}] * 80)
    moved = abs(rows[-1]["pv"] - quiet[-1])
    assert moved > 1e-3 * abs(quiet[-1])
    if name != "level":  # its outflow balances what flows in at the start
        assert rows[-1]["pv"] == pytest.approx(loaded[-1], abs=0.2 * moved)


@pytest.mark.parametrize("name", ONE_LOOP)
def test_controller_inside_is_the_controller_outside(name: str) -> None:
    """The PI of the compensator package, sample by sample, against the one in the FMU."""
    source = read_model(SOURCES / f"{name}.c")
    start = {variable.name: variable.start for variable in source.variables}
    period = catalogue[name].period
    settings = PiSettings(start["pi_gain"], start["pi_time"], period, OpLimits(0.0, 100.0))
    targets = [start["sp"]] * 20 + [1.05 * start["sp"]] * 150
    controller, op, outside = PiController(settings), 40.0, []
    with open_plant(name, parameters={"op": op}, isolated=False) as plant:
        pv = plant.outputs()["pv"]
        for sp in targets:
            controller.observe(pv, op)
            op = controller.decide(sp).op
            outside.append(plant.step({"op": op}))
            pv = outside[-1]["pv"]
    with open_plant(name, parameters={"op": 40.0, "controller": 1}, isolated=False) as plant:
        inside = plant.steps([{"sp": sp} for sp in targets])
    for key in ("pv", "op_out", "stem"):
        np.testing.assert_allclose(
            [row[key] for row in inside], [row[key] for row in outside], rtol=1e-9, atol=1e-9
        )
    assert np.ptp([row["op_out"] for row in inside]) > 1.0


@pytest.mark.parametrize("name", ONE_LOOP)
def test_default_tuning_settles_with_a_healthy_valve(name: str) -> None:
    parameters = {"controller": 1, "valve": 0, "noise_std": 0.0, "op_start": 45.0}
    with open_plant(name, parameters=parameters, isolated=False) as plant:
        rows = plant.steps([{}] * 1500)
    last = np.array([row["pv"] for row in rows[-200:]])
    target = next(v.start for v in read_model(SOURCES / f"{name}.c").variables if v.name == "sp")
    np.testing.assert_allclose(last, target, rtol=2e-3)


def test_controller_takes_over_without_a_bump() -> None:
    with open_plant("flow", parameters={"noise_std": 0.0, "op_start": 62.0}) as plant:
        rest = plant.step({"op": 62.0, "sp": 20.0})
        before = rest["op_out"]
        after = plant.step({"controller": 1, "sp": rest["pv"]})["op_out"]
    assert before == 62.0
    assert after == pytest.approx(62.0, abs=1e-9)


def test_the_same_noise_whatever_the_valve() -> None:
    op = wandering_op(100)
    noise = [
        run("heat", op, valve=kind)["pv"] - run("heat", op, valve=kind, noise_std=0.0)["pv"]
        for kind in (0, 1)
    ]
    np.testing.assert_allclose(noise[0], noise[1], atol=1e-9)
