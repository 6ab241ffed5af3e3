"""Does `physical` move as if it took every step of its grid of 0.1 ms? For `benchmarks.fmu`.

The reference is the same model that takes every step. With OP given the two are compared sample by
sample. In a closed loop a cycle with friction is chaotic: whatever differs, be it by rounding,
grows. There the second is counted at which the stem differs by 1 % of S, and beside it the same
for the reference against itself, begun at an OP that differs by 1e-12 %.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmu_models import open_plant
from fmu_models.packing import build_source
from fmu_models.tables import SOURCES

__all__ = ["LIMIT", "MOVES", "build_every_step", "compare_grids", "move_op", "run_stem"]

LIMIT = 0.01
"""Part of S that the stem may differ by."""
MOVES = ("walk", "steps", "wave")
_SKIPS = "const int skips = (int)p->v.valve != VALVE_LUGRE;"
_STICK_BANDS = (2.0, 5.0, 8.0, 15.0)
_JUMP_SHARES = (0.25, 0.6)
_LAGS = (0.05, 0.2, 1.0)
_SAMPLES = 300
_CLOSED_SAMPLES = 3000
_NUDGE = 1e-12


def build_every_step(folder: Path) -> Path:
    """Build `physical` so that it takes every step of its grid; return its FMU."""
    text = (SOURCES / "physical.c").read_text()
    if _SKIPS not in text:
        raise RuntimeError(f"physical.c has no line {_SKIPS!r} any more; follow it here")
    copy = folder / "physical.c"
    copy.write_text(text.replace(_SKIPS, "const int skips = 0;"))
    return build_source(copy, output=folder)[1]


def move_op(kind: str, seed: int, samples: int = _SAMPLES) -> NDArray[np.float64]:
    """Return an OP of ``samples`` samples in percent that walks, steps or waves."""
    generator, k = np.random.default_rng(seed), np.arange(samples)
    if kind == "walk":
        return np.clip(50.0 + np.cumsum(generator.normal(0.0, 2.0, samples)), -5.0, 105.0)
    if kind == "steps":
        return np.repeat(generator.uniform(-10.0, 110.0, samples // 10), 10)
    return 50.0 + 12.0 * np.sin(k / 40.0 + generator.uniform(0.0, 2.0 * np.pi))


def run_stem(
    model: Path | str,
    parameters: Mapping[str, float],
    op: NDArray[np.float64] | None = None,
    samples: int = _CLOSED_SAMPLES,
) -> NDArray[np.float64]:
    """Return the stem under a given OP, or with the controller inside for ``samples`` samples."""
    given = dict(parameters)
    if op is None:
        given["controller"] = 1.0
    else:
        given |= {"op": float(op[0]), "noise_std": 0.0}
        samples = op.size
    with open_plant(model, parameters=given, isolated=False) as plant:
        return plant.run(samples, {} if op is None else {"op": op})["stem"]


def _parts_at(
    model: Path | str, other: Path, parameters: Mapping[str, float], nudge: float = 0.0
) -> float:
    """Return the second at which two closed loops differ by the limit; infinity for never."""
    start = {"op_start": 40.0}
    gap = np.abs(
        run_stem(model, {**parameters, "op_start": 40.0 + nudge})
        - run_stem(other, {**parameters, **start})
    )
    apart = np.flatnonzero(gap > LIMIT * parameters["stick_band"])
    return float(apart[0]) if apart.size else np.inf


def compare_grids(folder: Path) -> list[list[object]]:
    """Return a row for each S and lag: the largest differences, and when closed loops part.

    A row holds S, lag, how many runs, the largest difference in percent of S, and the second at
    which closed loops part: of `physical`, and of the reference begun 1e-12 % beside itself.
    """
    reference = build_every_step(folder)
    rows: list[list[object]] = []
    seeds = itertools.count(1)
    for stick_band, lag in itertools.product(_STICK_BANDS, _LAGS):
        worst, runs = 0.0, 0
        for share, kind in itertools.product(_JUMP_SHARES, MOVES):
            parameters = _settings(stick_band, share, lag)
            op = move_op(kind, next(seeds))
            gap = run_stem("physical", parameters, op) - run_stem(reference, parameters, op)
            worst, runs = max(worst, float(np.abs(gap).max()) / stick_band), runs + 1
        closed = _settings(stick_band, _JUMP_SHARES[0], lag)
        ours = _parts_at("physical", reference, closed)
        itself = _parts_at(reference, reference, closed, _NUDGE)
        rows.append([stick_band, lag, runs, f"{100.0 * worst:.1e}", _shown(ours), _shown(itself)])
    return rows


def _shown(second: float) -> str:
    return f"{second:.0f}" if second < np.inf else f"not in {_CLOSED_SAMPLES}"


def _settings(stick_band: float, share: float, lag: float) -> dict[str, float]:
    return {"stick_band": stick_band, "slip_jump": share * stick_band, "actuator_lag": lag}
