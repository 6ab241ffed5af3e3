"""Draws one loop of the report family: simulates it, cuts a window, records it as a plant would."""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from benchmarks.families.loop import RecordedLoop
from benchmarks.families.report.closed_loop import Wiring, simulate
from benchmarks.families.report.kinds import KINDS, Kind
from benchmarks.families.report.loads import measurement_noise
from benchmarks.families.report.oracle import log_ratio
from benchmarks.families.report.records import (
    hold_by_exception,
    lose_samples,
    quantise,
    store_box_car,
    store_swinging_door,
)
from benchmarks.families.report.scenario import Scenario, draw_scenario, log_uniform
from benchmarks.families.report.transmitter import add_spikes, freeze
from compiled import kernel

__all__ = ["draw"]

Array = NDArray[np.float64]
Rng = np.random.Generator

SETTLED = 300
"""Scans before a window may begin: the start at rest is over."""
SCANS = 2400
"""Scans simulated after that; twice as many where samples will be left out."""
PILOT = 800
"""Scans of the noiseless run that shows how far PV swings."""
LONGEST = 1800
"""Samples of a window at most."""
ATTEMPTS = 10
"""Draws until a loop shows what its kind asks for; the last one is returned as not assessable."""
LEAST_LOG_RATIO = 10.0
"""How much better the true stem must predict PV than OP does: the price of searching S and J."""
LEAST_BAND = 0.02
"""Least stick band as a share of OP's range in the window."""
LEAST_STROKES = 4
LEAST_PER_STROKE = 4.0
"""Samples in a stroke; a loop that is faster than its controller's scan is drawn again."""
STORED_PER_STROKE = 4.0
"""Own values of PV that a stroke must leave in the record for its shape to be known."""


@dataclass(frozen=True, slots=True)
class _Window:
    op: Array
    pv: Array
    sp: Array
    stem: Array
    strokes: int
    per_stroke: float
    own_values: float
    """Share of PV's samples that were measured then and not filled in later."""
    period: float
    notes: str


@kernel
def _turns(path: Array, least: float) -> Array:
    """Samples at which ``path`` turns round for more than ``least``, shape ``(m,)``."""
    found = np.empty(path.size)
    count, direction, extreme, at = 0, 0, path[0], 0
    for k in range(path.size):
        moved = path[k] - extreme
        if direction == 0:
            if abs(moved) > least:
                direction, extreme, at = (1 if moved > 0.0 else -1), path[k], k
        elif moved * direction > 0.0:
            extreme, at = path[k], k
        elif -moved * direction > least:
            found[count] = at
            count += 1
            direction, extreme, at = -direction, path[k], k
    return found[:count]


def _simulate(rng: Rng, kind: Kind, s: Scenario) -> tuple[Array, Array, Array, Array]:
    n = s.set_points.shape[1]
    pilot = slice(0, PILOT + SETTLED)
    _, quiet, sp, _ = simulate(
        s.plants,
        s.valves,
        s.controllers,
        s.wiring,
        s.set_points[:, pilot],
        s.inflow[:, pilot],
        s.outflow[:, pilot],
        np.zeros((2, PILOT + SETTLED)),
    )
    swing = float(np.std((quiet - sp)[SETTLED:]))
    wiring = _narrow_transmitter(rng, s, quiet[SETTLED:]) if kind.name == "saturation" else s.wiring
    noise = np.zeros((2, n))
    share = log_uniform(rng, 0.02, 0.35)
    if kind.name == "tight-tuning":
        share = rng.uniform(0.05, 0.6)
    noise[0] = share * swing * measurement_noise(rng, n)
    if kind.name in ("spikes", "frozen"):
        spoil = add_spikes if kind.name == "spikes" else freeze
        spoil(rng, noise[0, SETTLED:], swing)
    if s.wiring.second:
        ratio = abs(s.plants[1].gain / s.plants[0].gain)
        noise[1] = 0.3 * share * swing * ratio * measurement_noise(rng, n)
    return simulate(
        s.plants, s.valves, s.controllers, wiring, s.set_points, s.inflow, s.outflow, noise
    )


def _narrow_transmitter(rng: Rng, s: Scenario, pv: Array) -> Wiring:
    """A transmitter whose range ends inside PV's swing, where OP has no narrow limits already."""
    if s.controllers[0].high < 100.0 or s.controllers[0].low > 0.0:
        return s.wiring
    end = rng.uniform(0.05, 0.25)
    if rng.random() < 0.5:
        return s.wiring._replace(highest=float(np.quantile(pv, 1.0 - end)))
    return s.wiring._replace(lowest=float(np.quantile(pv, end)))


def _cut(rng: Rng, kind: Kind, s: Scenario, run: tuple[Array, Array, Array, Array]) -> _Window:
    op, pv, sp, stem = (signal[SETTLED:] for signal in run)
    least = 0.1 * s.stick_band if s.stick_band else 0.15 * float(np.ptp(stem))
    turns = _turns(stem, least)
    start = int(rng.integers(0, max(1, op.size // 4)))
    turns = turns[turns > start]
    wanted = int(rng.integers(4, 9)) if kind.name == "few-strokes" else int(log_uniform(rng, 8, 45))
    end = op.size if turns.size < wanted else int(turns[wanted - 1])
    longest = LONGEST * (2 if kind.name == "decimated" else 1)
    shortest = 100 if kind.name == "few-strokes" else 300
    end = min(max(end, start + shortest), start + longest, op.size)
    strokes = int((turns < end).sum()) + 1
    part = slice(start, end)
    per_stroke = (end - start) / strokes
    return _Window(op[part], pv[part], sp[part], stem[part], strokes, per_stroke, 1.0, s.period, "")


def _spread(signal: Array) -> float:
    return max(float(np.std(signal)), 1e-9)


def _store(rng: Rng, kind: Kind, s: Scenario, w: _Window) -> _Window:
    """The window after its transmitter, network and historian."""
    op, pv = w.op, w.pv
    if kind.name == "quantised":
        step = log_uniform(rng, 0.15, 1.2) * _spread(pv)
        pv, op = quantise(pv, step), quantise(op, float(rng.choice([0.1, 0.2, 0.5])))
        return replace(w, op=op, pv=pv, notes=f"PV step {step / _spread(w.pv):.2f} of its spread")
    pv = quantise(pv, log_uniform(rng, 0.001, 0.01) * _spread(pv))
    w = replace(w, op=op, pv=pv)
    if kind.name == "held":
        band = log_uniform(rng, 0.05, 0.5)
        longest = int(rng.integers(20, 120))
        pv, kept = hold_by_exception(pv, band * _spread(pv), longest)
        if rng.random() < 0.7:
            op = hold_by_exception(op, band * _spread(op) * rng.uniform(0.2, 1.0), longest)[0]
        return replace(w, op=op, pv=pv, own_values=kept.mean(), notes=f"held by {band:.2f}")
    if kind.name == "interpolated":
        band = log_uniform(rng, 0.05, 0.5)
        longest = int(rng.integers(30, 200))
        store = store_swinging_door if rng.random() < 0.6 else store_box_car
        pv, kept = store(pv, band * _spread(pv), longest)
        op = store(op, band * _spread(op) * rng.uniform(0.2, 1.0), longest)[0]
        return replace(
            w, op=op, pv=pv, own_values=kept.mean(), notes=f"{store.__name__} {band:.2f}"
        )
    if kind.name == "decimated":
        keep = max(2, int(w.per_stroke / rng.uniform(4.0, 10.0)))
        return replace(
            w,
            op=op[::keep],
            pv=pv[::keep],
            sp=w.sp[::keep],
            stem=w.stem[::keep],
            per_stroke=w.per_stroke / keep,
            period=w.period * keep,
            notes=f"one sample of {keep}",
        )
    if kind.name == "missing":
        lost = lose_samples(rng, pv.size, rng.uniform(0.04, 0.25))
        pv = np.where(lost, np.nan, pv)
        if rng.random() < 0.6:
            op = np.where(lost, np.nan, op)
        return replace(w, op=op, pv=pv, own_values=1.0 - lost.mean(), notes="samples lost")
    if kind.name == "noisy-op":
        noise = s.size * log_uniform(rng, 0.02, 0.15)
        op = op + noise * measurement_noise(rng, op.size)
        return replace(w, op=op, notes=f"OP read back with noise {noise / s.size:.2f} S")
    return w


def _clamp(rng: Rng, s: Scenario) -> Scenario:
    """OP's limits so near that loads drive the controller into one of them now and then."""
    reach = float(np.quantile(np.abs(s.inflow[0]), 0.95)) + 0.5 * s.stick_band
    room = reach * rng.uniform(0.35, 0.85)
    middle = s.plants[0].middle
    if rng.random() < 0.3:
        return s
    limit = {"high": middle + room} if rng.random() < 0.5 else {"low": middle - room}
    return replace(s, controllers=(s.controllers[0]._replace(**limit), s.controllers[1]))


def _share_at_rails(w: _Window) -> float:
    op, pv = w.op[np.isfinite(w.op)], w.pv[np.isfinite(w.pv)]
    rails = [(op == op.max()).mean(), (op == op.min()).mean()]
    rails += [(pv == pv.max()).mean(), (pv == pv.min()).mean()]
    return float(max(rails))


def _in_units(rng: Rng, w: _Window, s: Scenario) -> tuple[Array, Array, Array, float]:
    """OP, PV and set point in a plant's units, and the factor from % to OP's unit."""
    factor, zero = [(1.0, 0.0), (0.16, 4.0), (0.01, 0.0)][int(rng.choice(3, p=[0.86, 0.07, 0.07]))]
    scale = log_uniform(rng, 0.02, 20.0)
    base = scale * abs(s.plants[0].gain) * rng.uniform(-20.0, 200.0)
    return w.op * factor + zero, base + scale * w.pv, base + scale * w.sp, factor


def _describe(s: Scenario, w: _Window) -> str:
    p, c = s.plants[0], s.controllers[0]
    process = "level" if p.level else f"resonance {p.frequency:.2f}" if p.frequency else "lag"
    text = f"{process} {p.lag:.1f}+{p.second_lag:.1f} dead {p.dead_time:.1f} scans, "
    text += f"Ti {c.integral:.1f}, every {c.every}"
    return f"{text}; {w.notes}" if w.notes else text


def draw(kind: str, sticky: bool, seed: int) -> RecordedLoop:
    """The loop of ``kind`` with ``seed``, always the same one.

    Raises:
        ValueError: there is no such kind, or it does not come with that state of the valve.
    """
    if kind not in KINDS:
        raise ValueError(f"no kind of loop is called {kind}; there are {', '.join(KINDS)}")
    what = KINDS[kind]
    if not (what.sticky if sticky else what.healthy):
        raise ValueError(f"loops of kind {kind} do not come {'sticky' if sticky else 'healthy'}")
    n = SETTLED + SCANS * (2 if kind == "decimated" else 1)
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([crc32(kind.encode()), int(sticky), seed, attempt])
        s = draw_scenario(rng, what, sticky, n)
        if kind == "saturation":
            s = _clamp(rng, s)
        w = _cut(rng, what, s, _simulate(rng, what, s))
        enough = w.strokes >= LEAST_STROKES
        if not enough or w.per_stroke < (8.0 if kind == "decimated" else LEAST_PER_STROKE):
            continue
        w = _store(rng, what, s, w)
        enough = not sticky or s.stick_band >= LEAST_BAND * float(np.nanmax(w.op) - np.nanmin(w.op))
        if enough:
            break
    shown = enough and w.strokes >= LEAST_STROKES
    if sticky and shown:
        samples = (s.plants[0].dead_time + s.plants[0].sensor_lag) * s.period / w.period
        shown = log_ratio(w.op, w.pv, w.stem, samples) >= LEAST_LOG_RATIO
    op, pv, sp, factor = _in_units(rng, w, s)
    told = w.own_values * w.per_stroke >= STORED_PER_STROKE and _share_at_rails(w) < 0.5
    keep_sp = what.second or kind in ("setpoint-steps", "curved") or rng.random() < 0.6
    return RecordedLoop(
        name=f"report-{kind}-{'sticky' if sticky else 'healthy'}-{seed}",
        kind=kind,
        op=op,
        pv=pv,
        sp=sp if keep_sp else None,
        period=w.period,
        stick_band=s.stick_band * factor,
        slip_jump=s.slip_jump * factor,
        law=s.law,  # type: ignore[arg-type]
        assessable=told and shown,
        strokes=w.strokes,
        notes=_describe(s, w),
    )
