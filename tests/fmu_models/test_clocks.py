"""Clocks of FMI 3 that the FMU waits for: each beat of ``odd3.c`` holds u[2], an alarm follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_models import PlantStepError, open_plant, summarise

Odd = dict[str, Path]
KINDS = ["co-simulation", "model exchange"]


def ticks_before(moments: list[float], first: float) -> list[int]:
    """Ticks each 0.5 s from ``first`` on, before a moment: the tick at a moment is of the next."""
    return [sum(first + 0.5 * k < t - 1e-6 for k in range(99)) for t in moments]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("period", [0.25, 0.1, 0.7, 2.0])
def test_clocks_tick_at_their_moments(odd: Odd, kind: str, period: float) -> None:
    steps = 20
    moments = [period * k for k in range(1, steps + 1)]
    with open_plant(odd["clocked"], kind=kind, period=period) as plant:
        table = plant.run(steps, {})
    with open_plant(odd["events"], kind=kind, period=period) as plant:
        without = plant.run(steps, {})
    assert table["beats"].tolist() == ticks_before(moments, 0.25)
    assert table["alarms"].tolist() == ticks_before(moments, 0.45)
    np.testing.assert_allclose(table["x"], without["x"], rtol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tick_sees_the_inputs_of_its_moment(odd: Odd, kind: str) -> None:
    with open_plant(odd["clocked"], kind=kind, period=0.25) as plant:
        held = [plant.step({"u[2]": float(k)})["held"] for k in range(8)]
    assert held == [0.0, 1.0, 1.0, 3.0, 3.0, 5.0, 5.0, 7.0]  # sampled at 0.25, 0.75, ...


@pytest.mark.parametrize("kind", KINDS)
def test_a_snapshot_keeps_the_next_ticks(odd: Odd, kind: str) -> None:
    with open_plant(odd["clocked"], kind=kind, period=0.3) as plant:
        plant.run(3, {})
        snapshot = plant.snapshot()
        first = plant.run(9, {})
        plant.restore(snapshot)
        again = plant.run(9, {})
    for name in ("beats", "alarms", "x"):
        np.testing.assert_array_equal(first[name], again[name])


def test_a_tick_inside_of_a_step_that_cannot_be_shorter_is_named(odd: Odd) -> None:
    with (
        open_plant(odd["clocked-fixed"], period=1.0) as plant,
        pytest.raises(PlantStepError, match=r"ticks at 0\.25 s, within the step.*take a period"),
    ):
        plant.step({})


def test_clocks_of_other_fmus_are_named(odd: Odd) -> None:
    warnings = summarise(odd["clocked"]).warnings
    assert "input clocks that nothing triggers here: bell" in warnings
