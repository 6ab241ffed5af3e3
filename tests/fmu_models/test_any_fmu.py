"""FMUs that are not ours: FMI 1, model exchange, other tools' names, types and statuses."""

from __future__ import annotations

import contextlib
import time
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

from fmu_models import (
    PlantClosedError,
    PlantCrashError,
    PlantEndedError,
    PlantError,
    PlantFileError,
    PlantInputError,
    PlantNameError,
    PlantStepError,
    open_plant,
)
from fmu_models.compilers import compile_library, host_platform
from fmu_models.packing import _header_folder

Minis = dict[str, Path]
ALL = [("fmi1-cs", None), ("fmi1-me", None), ("fmi2", "co-simulation"), ("fmi2", "model exchange")]
EXCHANGE = [ALL[1], ALL[3]]
SEGFAULT, ENDLESS, SLOW = 2, 3, 6  # of faulty.c


@pytest.mark.parametrize("isolated", [True, False])
@pytest.mark.parametrize(("key", "kind"), ALL)
def test_every_kind_follows_the_analytic_solution(
    mini_fmus: Minis, key: str, kind: str | None, isolated: bool
) -> None:
    """dh/dt = mode * inflow - h; explicit steps of 1 ms inside the co-simulation ones."""
    with open_plant(
        mini_fmus[key],
        kind=kind,
        period=0.5,
        parameters={"tank.inflow[1]": 3.0},
        watch=["der(tank.h)"],
        isolated=isolated,
    ) as plant:
        assert plant.info.kind == (kind or ("model exchange" if "me" in key else "co-simulation"))
        assert plant.info.inputs == ("tank.inflow[1]", "pump.on", "mode")
        assert plant.info.outputs == ("tank.h", "alarm", "batch", "der(tank.h)")
        rows = plant.steps([{}] * 8)
        rows += plant.steps([{"mode": 2}] * 8)
        rows += plant.steps([{"pump.on": 0.0}] * 8)
    t = np.arange(0.5, 12.1, 0.5)
    filling = 3.0 * (1.0 - np.exp(-t[:8]))
    fast = 6.0 + (filling[-1] - 6.0) * np.exp(-(t[8:16] - 4.0))
    level = np.concatenate([filling, fast, fast[-1] * np.exp(-(t[16:] - 8.0))])
    np.testing.assert_allclose([row["tank.h"] for row in rows], level, atol=3e-3)
    inflow = np.repeat([3.0, 6.0, 0.0], 8)
    np.testing.assert_allclose([row["der(tank.h)"] for row in rows], inflow - level, atol=3e-3)
    assert [row["batch"] for row in rows] == [float(moment >= 5) + (moment >= 10) for moment in t]
    alarm = [row["alarm"] for row in rows]
    assert alarm[2:18] == [1.0] * 16
    assert alarm[:2] == [0.0] * 2
    assert alarm[-1] == 0.0


@pytest.mark.parametrize(("key", "kind"), EXCHANGE)
def test_model_exchange_finds_the_moment_of_a_state_event(
    mini_fmus: Minis, key: str, kind: str | None
) -> None:
    """h passes 2 at ln 3: before it there is no alarm, after it there is."""
    moment = np.log(3.0)
    for period, alarm in ((moment - 1e-3, 0.0), (moment + 1e-3, 1.0)):
        with open_plant(
            mini_fmus[key],
            kind=kind,
            period=float(period),
            parameters={"tank.inflow[1]": 3.0},
            isolated=False,
        ) as plant:
            assert plant.step({})["alarm"] == alarm


@pytest.mark.parametrize("kind", ["co-simulation", "model exchange"])
@pytest.mark.parametrize("isolated", [True, False])
def test_snapshot_replays_bit_for_bit(mini_fmus: Minis, kind: str, isolated: bool) -> None:
    inputs = [{"tank.inflow[1]": 2.0 + (k % 5), "mode": 1 + k % 2} for k in range(30)]
    with open_plant(mini_fmus["fmi2"], kind=kind, period=0.4, isolated=isolated) as plant:
        plant.steps(inputs)
        snapshot = plant.snapshot()
        first = plant.steps(inputs)
        plant.restore(snapshot)
        assert plant.steps(inputs) == first
        assert len({row["tank.h"] for row in first}) == 30


@pytest.mark.parametrize(("key", "kind"), ALL)
def test_columns_are_single_steps(mini_fmus: Minis, key: str, kind: str | None) -> None:
    inflow = 2.0 + np.sin(np.arange(40) / 3.0)
    mode = 1.0 + (np.arange(40) % 3 == 0)
    with open_plant(mini_fmus[key], kind=kind, period=0.25, isolated=False) as plant:
        rows = plant.steps(
            [{"tank.inflow[1]": a, "mode": b} for a, b in zip(inflow, mode, strict=True)]
        )
    with open_plant(mini_fmus[key], kind=kind, period=0.25) as plant:
        table = plant.run(40, {"tank.inflow[1]": inflow, "mode": mode})
        assert plant.outputs() == rows[-1]
    for name, values in table.items():
        assert values.tolist() == [row[name] for row in rows]


def test_discarded_step_and_stop(mini_fmus: Minis) -> None:
    for key in ("fmi1-cs", "fmi2"):
        with (
            open_plant(mini_fmus[key], period=2.0) as plant,
            pytest.raises(
                PlantStepError, match=r"discarded the step of 2 s, it got to 0 s; try an"
            ),
        ):
            plant.step({})
    with (
        open_plant(mini_fmus["fmi2"], period=1.0) as plant,
        pytest.raises(PlantStepError, match=r"ended the simulation at 0 s \(has it reached its st"),
    ):
        plant.step({"fault": 5})


@pytest.mark.parametrize("isolated", [True, False])
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (3, r"status 3 \(error\).*: asked for status 3"),
        (4, r"status 4 \(fatal\).*: asked for status 4"),
        (6, "output tank.h is nan at 1 s"),
        (7, "output tank.h is inf at 1 s"),
    ],
)
def test_status_of_a_step(mini_fmus: Minis, fault: int, words: str, isolated: bool) -> None:
    with open_plant(mini_fmus["fmi2"], period=1.0, isolated=isolated) as plant:
        with pytest.raises(PlantStepError, match=words):
            plant.step({"fault": fault})
        with pytest.raises(PlantClosedError, match="failed before"):
            plant.step({})
    with (
        open_plant(mini_fmus["fmi2"], period=1.0, isolated=isolated) as plant,
        pytest.raises(PlantStepError, match=words),
    ):
        plant.run(3, {"fault": fault})


def test_warning_is_no_failure(mini_fmus: Minis) -> None:
    with open_plant(mini_fmus["fmi2"], period=1.0) as plant:
        assert plant.step({"fault": 1, "tank.inflow[1]": 1.0})["tank.h"] > 0.6


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (3, r"fmi2GetDerivatives failed with status 3"),
        (6, r"the solver failed between 0 s and 1 s"),
    ],
)
def test_model_exchange_that_fails_inside_the_solver(
    mini_fmus: Minis, fault: int, words: str
) -> None:
    with (
        open_plant(mini_fmus["fmi2"], kind="model exchange", period=1.0) as plant,
        pytest.raises(PlantStepError, match=words),
    ):
        plant.step({"fault": fault, "tank.inflow[1]": 1.0})


@pytest.mark.parametrize(("fault", "words"), [(8, "do not come to an end"), (5, "ended the simul")])
def test_events_that_do_not_end_or_end_all(mini_fmus: Minis, fault: int, words: str) -> None:
    with (
        open_plant(mini_fmus["fmi2"], kind="model exchange", period=1.0) as plant,
        pytest.raises(PlantStepError, match=words),
    ):
        plant.step({"fault": fault})


def test_values_that_do_not_fit_their_type(mini_fmus: Minis) -> None:
    with open_plant(mini_fmus["fmi1-cs"], period=1.0) as plant:
        with pytest.raises(PlantInputError, match=r"pump\.on = 2 cannot be set; it must be 0 or 1"):
            plant.step({"pump.on": 2.0})
        with pytest.raises(PlantInputError, match=r"mode = 1\.5 cannot be set"):
            plant.run(2, {"mode": np.array([1.0, 1.5])})
        with pytest.raises(PlantInputError, match=r"tank\.inflow\[1\] = nan cannot be set"):
            plant.run(2, {"tank.inflow[1]": np.array([1.0, np.nan])})
        with pytest.raises(PlantInputError, match=r"mode has the shape \(3,\)"):
            plant.run(2, {"mode": [1, 1, 1]})
        assert plant.step({"tank.inflow[1]": 1.0})["tank.h"] > 0.6


def test_names_of_other_tools_are_suggested(mini_fmus: Minis) -> None:
    with pytest.raises(PlantNameError, match=r"'tank.inflow'; did you mean 'tank\.inflow\[1\]'"):
        open_plant(mini_fmus["fmi2"], period=1.0, parameters={"tank.inflow": 1.0})
    with pytest.raises(PlantNameError, match=r"no number 'der\(h\)'; did you mean"):
        open_plant(mini_fmus["fmi2"], period=1.0, watch=["der(h)"])


def test_wrong_guid_is_reported_in_the_fmus_words(mini_fmus: Minis, tmp_path: Path) -> None:
    for key in ("fmi1-cs", "fmi2"):
        wrong = tmp_path / f"{key}.fmu"
        with zipfile.ZipFile(mini_fmus[key]) as source, zipfile.ZipFile(wrong, "w") as copy:
            for name in source.namelist():
                copy.writestr(name, source.read(name).replace(b'guid="{mini}"', b'guid="{other}"'))
        with pytest.raises(PlantFileError, match="refused to be instantiated: the GUID is"):
            open_plant(wrong, period=1.0)


def test_no_step_size_is_named(mini_fmus: Minis) -> None:
    with pytest.raises(PlantError, match="names no step size; give the period in seconds"):
        open_plant(mini_fmus["fmi2"])


@pytest.mark.parametrize(("key", "kind"), EXCHANGE)
def test_model_exchange_agrees_with_fmpys_own_loop(
    mini_fmus: Minis, key: str, kind: str | None
) -> None:
    result = fmpy.simulate_fmu(
        str(mini_fmus[key]),
        fmi_type="ModelExchange",
        stop_time=8.0,
        record_events=False,
        output_interval=0.5,
        relative_tolerance=1e-8,
        start_values={"tank.inflow[1]": 3.0},
        output=["tank.h", "alarm", "batch"],
        validate=False,
    )
    with open_plant(
        mini_fmus[key], kind=kind, period=0.5, parameters={"tank.inflow[1]": 3.0}
    ) as plant:
        table = plant.run(16, {})
    for name, values in table.items():
        np.testing.assert_allclose(values, result[name][1:], atol=2e-4)


def test_casadi_exports_run(tmp_path: Path) -> None:
    """FMI 3 model exchange, made by another tool in the test run: dx/dt = u - 2 x."""
    casadi = pytest.importorskip("casadi", reason="the extra nlp is not installed")
    with contextlib.chdir(tmp_path):
        dae = casadi.DaeBuilder("decay")
        x = dae.add("x", "output", {"start": 1.0})
        u = dae.add("u", "input", {"start": 0.0})
        dae.eq(dae.der(x), u - 2.0 * x)
        entries = dae.export_fmu({"no_warning": True})
        library = f"binaries/{fmpy.platform_tuple}/decay{fmpy.sharedLibraryExtension}"
        bundle = tmp_path / "all.c"
        bundle.write_text('#include "decay.c"\n#include "decay_wrap.c"\n')
        compile_library(
            bundle, (tmp_path, _header_folder()), tmp_path / "decay.so", host_platform()
        )
        with zipfile.ZipFile(tmp_path / "decay.fmu", "w") as archive:
            archive.write("decay.so", library)
            for local, inside in entries.items():
                archive.write(local, inside)
    for isolated in (True, False):
        with open_plant(tmp_path / "decay.fmu", period=0.1, isolated=isolated) as plant:
            assert plant.info.fmi_version.startswith("3.")
            assert plant.info.kind == "model exchange"
            values = plant.run(20, {"u": np.where(np.arange(20) < 10, 0.0, 4.0)})["x"]
        t = np.arange(0.1, 1.05, 0.1)
        falling = np.exp(-2.0 * t)
        rising = 2.0 + (falling[-1] - 2.0) * np.exp(-2.0 * t)
        np.testing.assert_allclose(values, [*falling, *rising], atol=1e-3)


@pytest.mark.parametrize("isolated", [True, False])
@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        (2, PlantStepError, "the FMU discarded the step of 1 s, it got to 2 s; try another"),
        (3, PlantStepError, "asked for status 3"),
        (4, PlantStepError, "asked for status 4; after a fatal status FMI allows no further call"),
        (5, PlantEndedError, r"the FMU ended the simulation at 2 s \(has it reached its stop time"),
        (6, PlantStepError, "output tank.h is nan at 3 s"),
    ],
)
def test_steps_before_a_failure_are_kept(
    mini_fmus: Minis, fault: int, error: type[PlantError], words: str, isolated: bool
) -> None:
    faults = np.array([0.0, 0.0, fault, 0.0, 0.0])
    with open_plant(mini_fmus["fmi2"], period=1.0, isolated=isolated) as plant:
        whole = plant.run(2, {"tank.inflow[1]": 2.0})
    kept = []
    with open_plant(mini_fmus["fmi2"], period=1.0, isolated=isolated) as plant:
        pieces = plant.run_pieces(5, {"tank.inflow[1]": 2.0, "fault": faults})
        with pytest.raises(error, match=words):
            kept.extend(pieces)
        with pytest.raises(PlantClosedError, match="has ended" if fault == 5 else "failed before"):
            plant.step({})
    assert np.concatenate([piece.time for piece in kept]).tolist() == [1.0, 2.0]
    level = np.concatenate([piece.columns["tank.h"] for piece in kept])
    np.testing.assert_array_equal(level, whole["tank.h"])


@pytest.mark.parametrize(("fault", "words"), [(SEGFAULT, "SIGSEGV"), (ENDLESS, "did not answer")])
def test_steps_before_a_crash_are_kept(faulty: Path, fault: int, words: str) -> None:
    """One message carries all five steps; the process dies, or hangs, in the third."""
    kept = []
    with open_plant(faulty) as plant:
        # Short only where no answer will come, and longer than a busy machine needs for two steps.
        plant._link.timeout = 2.5 if fault == ENDLESS else 60.0
        pieces = plant.run_pieces(5, {"fault": np.array([0.0, 0.0, fault, 0.0, 0.0])})
        with pytest.raises(PlantCrashError, match=words):
            kept.extend(pieces)
    assert np.concatenate([piece.time for piece in kept]).tolist() == [1.0, 2.0]


def test_timeout_is_of_a_step_not_of_a_run(faulty: Path) -> None:
    """Ten steps of 0.3 s and more in one message; none takes nearly as long as the time-out."""
    with open_plant(faulty, timeout=2.7, parameters={"fault": SLOW}) as plant:
        begun = time.monotonic()
        assert plant.run(10, {})["steps"].tolist() == list(range(1, 11))
        assert time.monotonic() - begun > 2.7


def test_a_last_step_may_be_shorter(mini_fmus: Minis) -> None:
    for isolated in (True, False):
        with open_plant(mini_fmus["fmi2"], period=1.0, isolated=isolated) as plant:
            pieces = list(plant.run_pieces(3, {"tank.inflow[1]": 2.0}, last=0.25))
            assert plant.time == 2.25
            snapshot = plant.snapshot()
            after = plant.step({})
            plant.restore(snapshot)
            assert plant.time == 2.25
            assert plant.step({}) == after
        assert np.concatenate([piece.time for piece in pieces]).tolist() == [1.0, 2.0, 2.25]
        level = np.concatenate([piece.columns["tank.h"] for piece in pieces])
        np.testing.assert_allclose(level, 2.0 * (1.0 - np.exp([-1.0, -2.0, -2.25])), atol=2e-3)


def test_after_a_fatal_status_nothing_of_the_fmu_is_called(mini_fmus: Minis) -> None:
    with open_plant(mini_fmus["fmi2"], period=1.0, isolated=False) as plant:
        snapshot = plant.snapshot()
        with pytest.raises(PlantStepError, match="status 4"):
            plant.step({"fault": 4})
        with pytest.raises(
            PlantClosedError, match=r"must not be called any more.*open it again, is"
        ):
            plant.restore(snapshot)
