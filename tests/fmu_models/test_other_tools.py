"""FMUs that other tools exported: OpenModelica's, pythonfmu's and pythonfmu3's."""

from __future__ import annotations

import importlib.util
import re
import shutil
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy import integrate

from fmu_models import PlantStepError, open_plant, summarise
from tests.fmu_models.python_fmus import TOOLS, build, is_installed


@pytest.fixture(scope="module", params=TOOLS)
def python_fmu(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not is_installed(request.param):
        pytest.skip(f"{request.param} is not installed: pip install {request.param}")
    return build(request.param, tmp_path_factory.mktemp(request.param))


def test_python_fmus_run(python_fmu: Path) -> None:
    summary = summarise(python_fmu)
    assert (
        "it needs the tool that exported it (or its run time) on this machine" in summary.warnings
    )
    with open_plant(python_fmu, period=0.1) as plant:
        table = plant.run(40, {"inflow": np.where(np.arange(40) < 20, 2.0, 0.0)})
    level, expected = 1.0, []
    for k in range(40):
        level += 0.1 * ((2.0 if k < 20 else 0.0) - 0.5 * level)
        expected.append(level)
    np.testing.assert_allclose(table["level"], expected, rtol=1e-12)
    assert table["count"].tolist() == list(range(1, 41))
    assert table["high"].tolist() == [float(value > 2.0) for value in expected]


def test_a_step_that_a_python_fmu_refuses(python_fmu: Path) -> None:
    third = summarise(python_fmu).fmi_version.startswith("3")
    why = (
        "the step from 0 s by 0.1 s failed: the FMU discarded the step of 0.1 s"
        if third
        else "the FMU ended the simulation at 0 s"
    )
    with (
        open_plant(python_fmu, period=0.1) as plant,
        pytest.raises(PlantStepError, match=re.escape(why)),
    ):
        plant.step({"inflow": -1.0})


def test_the_text_of_an_exception_inside_reaches_the_user(python_fmu: Path) -> None:
    for isolated in (True, False):
        kept = []
        with open_plant(python_fmu, period=0.1, isolated=isolated) as plant:
            pieces = plant.run_pieces(4, {"inflow": np.array([1.0, 1.0, 99.0, 1.0])})
            with pytest.raises(PlantStepError, match="the pipe has burst"):
                kept.extend(pieces)
        assert sum(len(piece.time) for piece in kept) == 2


# OpenModelica's, from the wheel of gemseo-fmu; pip install --no-deps gemseo-fmu is enough.


@pytest.fixture(scope="module")
def modelica() -> Path:
    spec = importlib.util.find_spec("gemseo_fmu")
    if spec is None or spec.origin is None:
        pytest.skip("no OpenModelica FMUs here: pip install --no-deps gemseo-fmu")
    folder = Path(spec.origin).parent / "problems" / "fmu_files" / "linux"
    if fmpy.platform != "linux64" or not folder.is_dir():
        pytest.skip("the OpenModelica FMUs at hand are for Linux on x86-64")
    return folder


@pytest.mark.parametrize("isolated", [True, False])
@pytest.mark.parametrize(("kind", "tolerance"), [("model exchange", 2e-4), ("co-simulation", 0.2)])
def test_openmodelica_masses_and_springs(
    modelica: Path, kind: str, tolerance: float, isolated: bool
) -> None:
    """Two masses and three springs against SciPy; its co-simulation takes explicit Euler steps."""
    m1, m2, k1, k2, k3 = 1.0, 2.0, 1.5, 0.7, 1.1

    def rates(_: float, s: list[float]) -> list[float]:
        x1, v1, x2, v2 = s
        return [v1, (-k1 * x1 + k2 * (x2 - x1)) / m1, v2, (-k2 * (x2 - x1) - k3 * x2) / m2]

    parameters = {"m1": m1, "m2": m2, "k1": k1, "k2": k2, "k3": k3}
    period = 0.05 if kind == "model exchange" else 0.005
    steps = round(3.0 / period)
    with open_plant(
        modelica / "MassSpringSystem.fmu",
        kind=kind,
        period=period,
        parameters=parameters,
        isolated=isolated,
    ) as plant:
        first = plant.outputs()
        table = plant.run(steps, {})
    start = [first[name] for name in ("x1", "v1", "x2", "v2")]
    assert any(start)  # it does move
    t = period * np.arange(1, steps + 1)
    solution = integrate.solve_ivp(rates, (0.0, 3.0), start, t_eval=t, rtol=1e-10, atol=1e-12)
    for name, expected in zip(("x1", "v1", "x2", "v2"), solution.y, strict=True):
        np.testing.assert_allclose(table[name], expected, atol=tolerance * np.ptp(expected))


def test_openmodelica_state_event(modelica: Path) -> None:
    """A ramp with two event indicators: the corner lies between two samples."""
    result = fmpy.simulate_fmu(
        str(modelica / "ramp.fmu"),
        fmi_type="ModelExchange",
        output_interval=0.037,
        stop_time=3.7,
        record_events=False,
        validate=False,
    )
    with open_plant(modelica / "ramp.fmu", kind="model exchange", period=0.037) as plant:
        table = plant.run(100, {})
    np.testing.assert_allclose(table["out"], result["out"][1:101], atol=1e-6)
    assert np.ptp(table["out"]) > 0.5


@pytest.mark.parametrize("kind", ["co-simulation", "model exchange"])
def test_openmodelica_inputs_and_internal_names(modelica: Path, kind: str) -> None:
    with open_plant(modelica / "add.fmu", kind=kind, period=0.1) as plant:
        table = plant.run(3, {"u1": [1.0, 2.0, 3.0], "u2": 10.0})
        assert table["y"].tolist() == [11.0, 12.0, 13.0]
    names = ["der(der(mass.flange_b.s))", "mass.flange_b.s"]
    with open_plant(
        modelica / "Mass_Damper.fmu", kind="model exchange", period=0.01, watch=names
    ) as plant:
        outputs = plant.run(100, {"f": 1.0})
    assert set(names) < set(outputs)
    assert np.ptp(outputs["mass.flange_b.s"]) > 0.0


def test_an_fmu_of_gemseos_wheel_made_by_pythonfmu3(modelica: Path, tmp_path: Path) -> None:
    """FMI 3 with every type of number; texts may be given and are named, arrays are columns."""
    copy = shutil.copy(modelica / "FMU3Model.fmu", tmp_path / "typed.fmu")
    summary = summarise(copy)
    assert "texts that can be given at the start: string" in summary.warnings
    assert not any("arrays" in warning for warning in summary.warnings)
    with zipfile.ZipFile(copy) as archive:
        assert "modelDescription.xml" in archive.namelist()
    with open_plant(copy, period=1.0) as plant:
        before = plant.outputs()["output"]
        assert plant.step({"input": 5.0, "boolean": True, "int32": 7})["output"] != before
