"""One loop from (kind, sticky, seed): process, tuning, valve, disturbances, noise and record."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import cast

import numpy as np

from benchmarks.families.loop import Law, RecordedLoop
from benchmarks.families.tuning.closed_loop import LoopPart, Simulated
from benchmarks.families.tuning.loads import Floats, count_knots, find_strokes
from benchmarks.families.tuning.records import compress, draw_holes, draw_spikes, hold
from benchmarks.families.tuning.scenes import SHORTEST_WINDOW, Scene, draw_scene, log_uniform

__all__ = ["HEALTHY_KINDS", "KINDS", "STICKY_KINDS", "draw"]

_ONLY_STICKY = ("pure-slip", "dead-band", "he", "kano", "sliding", "karnopp", "lugre")
_ONLY_HEALTHY = ("tight-tuning",)
_BOTH = (
    *("pi", "integrating", "cascade", "interacting", "sine", "triangle", "sines", "load-steps"),
    *("ramps", "drift", "saturation", "curved", "quantised", "held", "interpolated", "decimated"),
    *("missing", "noisy-op", "sensor-lag", "oscillatory", "few-strokes", "setpoint-steps"),
    *("spikes", "frozen"),
)
HEALTHY_KINDS = (*_BOTH, *_ONLY_HEALTHY)
STICKY_KINDS = (*_BOTH, *_ONLY_STICKY)
KINDS = (*_BOTH, *_ONLY_STICKY, *_ONLY_HEALTHY)

LEAST_STROKES = 4
"""Fewer travels of the stem show no limit cycle; the loop is drawn again."""

MOST_ATTEMPTS = 200
"""Draws of one name before it is given up."""

KNOTS_PER_STROKE = 4
"""A historian's record with fewer stored points per stroke does not show how the stem moved."""

LEAST_KNOTS = 40
"""Four stored points per unknown of process, valve and noise, of which there are about ten."""

LARGEST_NOISE = 0.34
"""Standard deviation of PV's noise over that of PV's own cycle."""


def draw(kind: str, sticky: bool, seed: int) -> RecordedLoop:
    """Draw the loop of that kind and seed; the same arguments give the same loop.

    Raises:
        ValueError: no such kind, or a kind that is only drawn with the other sort of valve.
    """
    allowed = STICKY_KINDS if sticky else HEALTHY_KINDS
    if kind not in allowed:
        valve = "sticky" if sticky else "healthy"
        raise ValueError(f"no {valve} loops of kind {kind!r}; choose one of {', '.join(allowed)}")
    for attempt in range(MOST_ATTEMPTS):
        rng = np.random.default_rng([zlib.crc32(kind.encode()), int(sticky), seed, attempt])
        loop = _draw_once(kind, sticky, rng)
        if loop is not None:
            return replace(loop, name=f"{kind}-{'s' if sticky else 'h'}{seed}")
    raise RuntimeError(f"{kind} {seed}: no physically sensible loop in {MOST_ATTEMPTS} draws")


def _draw_once(kind: str, sticky: bool, rng: np.random.Generator) -> RecordedLoop | None:
    scene = draw_scene(kind, sticky, rng)
    part = scene.parts[0]
    cheap = replace(part, valve=replace(part.valve, law="he" if sticky else "none"))
    quiet = scene.run(cheap)
    if not _is_sensible(quiet, part.process.gain):
        return None
    control = part.controller
    if kind == "saturation":
        middle = float(np.median(quiet.op))
        if rng.uniform() < 0.5:
            control = replace(
                control, high=middle + (quiet.op.max() - middle) * rng.uniform(0.6, 0.9)
            )
        else:
            control = replace(
                control, low=middle - (middle - quiet.op.min()) * rng.uniform(0.6, 0.9)
            )
    cycle = max(float(np.std(quiet.pv)), 0.1 * abs(part.process.gain))
    share = log_uniform(rng, 0.003, LARGEST_NOISE)
    wanted = share * cycle
    # Noise that shakes OP by more than this would be filtered by any engineer.
    reach = (0.3 * part.valve.stick_band if sticky else 2.0) / abs(control.gain)
    noise = min(wanted, reach)
    if kind == "noisy-op":
        noise = reach * rng.uniform(0.5, 1.5)
        noise = min(noise, LARGEST_NOISE * cycle) if sticky else noise
        if noise < 0.15 * reach:
            return None
    if kind == "quantised":
        high = max(float(np.ptp(quiet.pv)), 0.5 * abs(part.process.gain))
        scene = replace(
            scene,
            quantum=(log_uniform(rng, 0.1, 1.0), high * log_uniform(rng, 0.01, 0.15)),
        )
    drawn = noise * rng.standard_normal(len(scene.sp))
    if kind == "spikes":
        drawn += draw_spikes(rng, drawn.size, cycle)
    if kind == "frozen":
        drawn[draw_holes(rng, drawn.size, rng.uniform(0.02, 0.2))] = np.nan
    part = replace(part, controller=control, noise=drawn)
    signals = scene.run(part)
    if not _is_sensible(signals, part.process.gain, allow_limits=kind == "saturation"):
        return None
    limited = _share_at(signals.op, control.low, control.high)
    if kind == "saturation" and not 0.03 < limited < 0.7:
        return None
    return _record(kind, scene, part, signals, noise / cycle, rng)


def _share_at(op: Floats, low: float, high: float) -> float:
    return float(np.mean((op <= low + 1e-9) | (op >= high - 1e-9)))


def _is_sensible(signals: Simulated, gain: float, *, allow_limits: bool = False) -> bool:
    if not np.isfinite(signals.pv).all() or np.ptp(signals.pv) > 80.0 * max(abs(gain), 1.0):
        return False
    return allow_limits or _share_at(signals.op, 0.0, 100.0) < 0.01


def _record(
    kind: str,
    scene: Scene,
    part: LoopPart,
    signals: Simulated,
    noise_share: float,
    rng: np.random.Generator,
) -> RecordedLoop | None:
    valve, every = part.valve, scene.every
    sticky = valve.law != "none"
    threshold = max(0.5 * valve.slip_jump, 0.1 * valve.stick_band)
    if not sticky:
        threshold = max(0.5, 0.25 * float(np.ptp(signals.stem)))
    starts = find_strokes(signals.stem, threshold)
    end = len(signals.stem)
    if kind == "few-strokes":
        wanted = int(rng.integers(LEAST_STROKES, 9))
        if len(starts) > wanted:
            end = int(starts[wanted])
        if end < SHORTEST_WINDOW:
            return None
    strokes = int(np.sum(starts < end))
    if strokes < LEAST_STROKES and (sticky or kind == "few-strokes"):
        return None
    op, pv, sp = (s[:end:every].copy() for s in (signals.op, signals.pv, signals.sp))
    notes = _describe(part, scene, noise_share)
    assessable = not sticky or len(op) >= KNOTS_PER_STROKE * strokes
    if kind in ("held", "interpolated"):
        # A straight line follows a cycle longer than a held value, at the same deviation.
        reach = (0.05, 0.6) if kind == "held" else (0.01, 0.3)
        shaking = float(np.nanstd(part.noise)) * np.array([abs(part.controller.gain), 1.0])
        # A deviation below the noise would store every sample.
        sizes = [
            max(log_uniform(rng, *reach) * float(np.std(s)), float(shake))
            for s, shake in zip((op, pv), shaking, strict=True)
        ]
        if kind == "held":
            op, pv = (np.asarray(hold(s, d)) for s, d in zip((op, pv), sizes, strict=True))
        else:
            op, pv = (np.asarray(compress(s, d, 120)) for s, d in zip((op, pv), sizes, strict=True))
        # A held value bends twice per stored point: before its step and at it.
        knots = (count_knots(op) + count_knots(pv)) // (4 if kind == "held" else 2)
        assessable = knots >= max(KNOTS_PER_STROKE * strokes, LEAST_KNOTS)
        notes += f", {knots} stored points"
    if kind == "missing":
        holes = draw_holes(rng, len(op), rng.uniform(0.05, 0.3))
        op[holes] = pv[holes] = np.nan
    if kind == "saturation":
        share = _share_at(signals.op, part.controller.low, part.controller.high)
        notes += f", {100 * share:.0f} % of the time at a limit"
    known = rng.uniform() < (0.85 if kind == "cascade" else 0.6) or kind == "setpoint-steps"
    return RecordedLoop(
        name=kind,
        kind=kind,
        op=op,
        pv=pv,
        sp=sp if known else None,
        period=float(rng.choice([0.5, 1.0, 2.0, 5.0, 10.0])) * every,
        stick_band=valve.stick_band,
        slip_jump=valve.slip_jump,
        law=cast(Law, valve.law),
        assessable=assessable,
        strokes=strokes,
        notes=notes,
    )


def _describe(part: LoopPart, scene: Scene, noise_share: float) -> str:
    p, c = part.process, part.controller
    text = (
        f"{p.form}, K {p.gain:.2f}, lag {p.lag:.1f}, dead time {p.dead_time:.1f} scans; "
        f"Kc {c.gain:.2f}, Ti {c.integral_time:.1f}, Td {c.derivative_time:.1f}; "
        f"noise {100 * noise_share:.1f} % of the cycle"
    )
    return text + (f"; every {scene.every}th scan" if scene.every > 1 else "")
