"""Systems of FMUs (SSP 1.0): masters, ends, the command line, exports, the shipped example."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldlink.cli.fmu import app
from fmu_models import (
    Master,
    PlantEndedError,
    PlantInputError,
    PlantNameError,
    open_plant,
    summarise,
)
from fmu_models.example_system import build_example_system
from tests.fmu_models.ssp_files import CHAIN, OWN, Minis, tank, write


def test_info_and_run_take_a_system(mini_fmus: Minis, tmp_path: Path) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    summary = summarise(file)
    assert (summary.fmi_version, summary.stop_time) == ("SSP 1.0", 4.0)
    assert "one step goes through first, then second (Gauss-Seidel)" in summary.warnings
    assert CliRunner().invoke(app, ["info", str(file)]).exit_code == 0
    out = tmp_path / "out.csv"
    done = CliRunner().invoke(
        app,
        ["run", str(file), "--step", "0.25", "--set", "feed=2", "--set", "first.mode=2",
         "--watch", "first.der(tank.h)", "--out", str(out)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    table = pd.read_csv(out)
    assert len(table) == 17
    np.testing.assert_allclose(table["first.tank.h"] + table["first.der(tank.h)"], 4.0, atol=1e-6)


def test_a_component_that_ends_or_is_unknown(mini_fmus: Minis, tmp_path: Path) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    with open_plant(file, period=0.5) as plant:
        kept = []
        faults = np.array([0.0, 0.0, 5.0])
        with pytest.raises(PlantEndedError, match="system two: plant mini: the FMU ended"):
            kept.extend(plant.run_pieces(3, {"second.fault": faults}))
        assert sum(piece.time.size for piece in kept) == 2
    with pytest.raises(PlantNameError, match=r"no component of 'third\.mode'"):
        open_plant(file, period=0.5, parameters={"third.mode": 1.0})


def test_jacobi_gives_everybody_the_values_of_the_step_before(
    mini_fmus: Minis, tmp_path: Path
) -> None:
    file = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    tables = [
        _run(file, master, isolated)
        for master, isolated in (("jacobi", True), ("jacobi", False), ("gauss-seidel", False))
    ]
    np.testing.assert_array_equal(tables[0]["level"], tables[1]["level"])
    np.testing.assert_array_equal(tables[0]["first.tank.h"], tables[2]["first.tank.h"])
    # The second tank is fed one step later, so its whole answer is.
    np.testing.assert_allclose(tables[0]["level"][1:], tables[2]["level"][:-1], atol=1e-12)
    with pytest.raises(PlantInputError, match="a master is for systems"):
        open_plant(mini_fmus["fmi2"], master="jacobi")


def _run(file: Path, master: Master, isolated: bool) -> dict[str, np.ndarray]:
    with open_plant(file, period=0.1, isolated=isolated, master=master) as plant:
        return plant.run(20, {"feed": 2.0})


def test_a_run_is_exported_as_a_system_that_repeats_it(mini_fmus: Minis, tmp_path: Path) -> None:
    system = write(
        tmp_path / "two.ssp", mini_fmus["fmi2"], tank("first") + tank("second"), CHAIN, own=OWN
    )
    for source, given in ((system, ["feed=2", "first.mode=fast"]), (mini_fmus["fmi2"], ["mode=2"])):
        exported, again = tmp_path / "run.ssp", tmp_path / "again.csv"
        options = [text for pair in given for text in ("--set", pair)]
        first = ["run", str(source), "--step", "0.25", "--stop", "3", "--in-process", *options]
        if source is system:
            first += ["--master", "jacobi"]
        done = CliRunner().invoke(app, [*first, "--export", str(exported)])
        assert done.exit_code == 0, done.output
        with zipfile.ZipFile(exported) as archive:
            kept = pd.read_csv(archive.open("extra/fieldlink/run.csv"))
        done = CliRunner().invoke(app, ["run", str(exported), "--in-process", "--out", str(again)])
        assert done.exit_code == 0, done.output
        repeated = pd.read_csv(again)
        pd.testing.assert_frame_equal(repeated[kept.columns], kept, check_exact=True)


def test_the_shipped_example_is_the_loop_in_one_fmu(tmp_path: Path) -> None:
    file = build_example_system(tmp_path)
    with open_plant(file) as plant:
        assert plant.info.period == 1.0
        system = plant.run(300, {"sp": 50.0})
    whole = {"controller": 1.0, "op_start": 40.0, "noise_std": 0.0}
    with open_plant("example1", parameters=whole) as plant:
        one = plant.run(300, {})
    for ours, theirs in (("op", "op_out"), ("pv", "pv"), ("stem", "stem")):
        np.testing.assert_allclose(system[ours], one[theirs], rtol=1e-12)
    assert np.ptp(one["stem"]) > 5.0
