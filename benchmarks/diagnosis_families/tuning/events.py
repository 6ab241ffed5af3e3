"""Plant-wide events: loops that disturb each other, one of which may start to swing."""

from __future__ import annotations

import itertools
import math
import zlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.diagnosis_families.records import EventRecord, Floats, LoopRecord
from benchmarks.diagnosis_families.tuning.network import Loop, Signals, simulate
from benchmarks.diagnosis_families.tuning.singles import (
    draw_healthy,
    log_uniform,
    spoil_tuning,
)

__all__ = ["PLANTS", "draw_event"]

PLANTS = ("recycle", "cascade", "heat", "header")
_WARM = 500
_ATTEMPTS = 80
_VISIBLE = 0.7
"""A loop swings with the event where it makes this share of the error's usual deviation."""


def draw_event(plant: str, source: str, seed: int, samples: int = 3000) -> EventRecord:
    """The plant of that kind, source and seed; the same arguments give the same plant."""
    key = zlib.crc32(f"{plant}/{source}".encode())
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([key, seed, attempt])
        found = _draw(plant, source, rng, samples, f"{plant}-{source}-{seed}")
        if found is not None:
            return found
    raise RuntimeError(f"no sensible plant for {plant} {source} {seed} in {_ATTEMPTS} draws")


def _couplings(
    plant: str, m: int, rng: np.random.Generator
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    couple = np.zeros((m, m))
    lag = np.exp(rng.uniform(math.log(1.0), math.log(25.0), (m, m)))
    master = np.full(m, -1, dtype=np.int64)
    sign = rng.choice([-1.0, 1.0], (m, m))
    size = rng.uniform(0.3, 0.9, (m, m)) * sign
    if plant == "recycle":
        for i in range(1, m):
            couple[i, i - 1] = size[i, i - 1]
        couple[0, m - 1] = 0.3 * size[0, m - 1]
    elif plant == "heat":
        for i in range(1, m):
            for j in rng.choice(i, min(i, 2), replace=False):
                couple[i, j] = size[i, j]
                if rng.uniform() < 0.3:
                    couple[j, i] = 0.3 * size[j, i]
    elif plant == "header":
        couple = -rng.uniform(0.05, 0.35, (m, m))
        np.fill_diagonal(couple, 0.0)
        couple *= min(1.0, 3.0 / m)
    else:
        for slave in range(0, m - 1, 2):
            if slave + 1 < m and rng.uniform() < 0.7:
                master[slave] = slave + 1
        inner = [i for i in range(m) if i not in set(master.tolist())]
        for before, after in itertools.pairwise(inner):
            couple[after, before] = size[after, before]
    return couple, lag, master


def _draw(
    plant: str, source: str, rng: np.random.Generator, samples: int, name: str
) -> EventRecord | None:
    m = int(rng.integers(6, 14))
    n = samples + _WARM
    loops = [draw_healthy(rng, n, integrating=0.15) for _ in range(m)]
    couple, lag, master = _couplings(plant, m, rng)
    for slave, outer in enumerate(master):
        if outer >= 0:
            inner = replace(draw_healthy(rng, n, integrating=0.0), second=0.5, delay=1)
            inner = replace(inner, gain=abs(inner.gain), kc=0.4 / abs(inner.gain) * 2.0, ti=4.0,
                            lag=4.0, td=0.0)  # fmt: skip
            slow = loops[outer]
            # one per cent of the outer OP is one unit of the inner PV
            loops[slave] = inner
            loops[outer] = replace(slow, kc=0.5 * slow.kc, td=0.0)
    quiet = simulate(loops, couple, lag, master)
    origin = None
    k = int(rng.integers(m))
    if source == "sticky_valve":
        k = _with_valve(k, master)
        stick = log_uniform(rng, 5.0, 15.0)
        loops[k] = replace(loops[k], stick=stick, jump=stick * rng.uniform(0.3, 1.0))
        origin = k
    elif source == "tight_tuning":
        k = _with_valve(k, master)
        loops[k] = _tight(loops[k], rng)
        origin = k
    elif source == "outside":
        period = log_uniform(rng, 40.0, 160.0)
        wave = np.sin(2.0 * math.pi * (np.arange(n) / period + rng.uniform()))
        wander = np.cumsum(rng.standard_normal(n)) * 0.01
        wave = np.sin(2.0 * math.pi * np.arange(n) / period + wander)
        hit = range(m) if plant == "header" else [_with_valve(k, master)]
        for i in hit:
            size = rng.uniform(3.0, 8.0) * float(rng.choice([-1.0, 1.0]))
            loops[i] = replace(loops[i], load=loops[i].load + size * wave)
    else:
        alone = [i for i in range(m) if i not in set(master.tolist()) and master[i] < 0]
        for i in rng.choice(alone, min(len(alone), int(rng.integers(0, 3))), replace=False):
            # a loop that swings alone: nothing reaches its neighbours
            couple[:, i] = 0.0
            i = int(i)
            loops[i] = replace(loops[i], stick=8.0, jump=5.0)
        quiet = simulate(loops, couple, lag, master)
    signals = simulate(loops, couple, lag, master)
    if not _is_sensible(signals, loops):
        return None
    members: list[int] = []
    if source != "none":
        made = signals.pv[:, _WARM:] - quiet.pv[:, _WARM:]
        usual = (quiet.pv - quiet.sp)[:, _WARM:].std(axis=1)
        members = [i for i in range(m) if made[i].std() > _VISIBLE * usual[i]]
        if len(members) < 2 or (origin is not None and origin not in members):
            return None
    return _record(name, plant, source, origin, members, master, loops, signals, rng)


def _with_valve(k: int, master: NDArray[np.int64]) -> int:
    """The loop itself, or the slave that moves the valve where it is a master."""
    for slave, outer in enumerate(master):
        if outer == k:
            return slave
    return k


def _tight(loop: Loop, rng: np.random.Generator) -> Loop:
    # a long dead time, so that the swing is slow enough to reach the neighbours
    slower = replace(loop, delay=max(loop.delay, 5))
    return spoil_tuning(slower, rng, "tight_tuning", (1.01, 1.08))


def _is_sensible(signals: Signals, loops: list[Loop]) -> bool:
    if not np.isfinite(signals.pv).all():
        return False
    for i, loop in enumerate(loops):
        op = signals.op[i, _WARM:]
        at_limit = float(np.mean((op <= loop.low + 1e-9) | (op >= loop.high - 1e-9)))
        if at_limit > 0.01 or np.ptp(op) > 95.0:
            return False
    return True


def _record(
    name: str,
    plant: str,
    source: str,
    origin: int | None,
    members: list[int],
    master: NDArray[np.int64],
    loops: list[Loop],
    signals: Signals,
    rng: np.random.Generator,
) -> EventRecord:
    names = [f"LC{100 + i}" for i in range(len(loops))]
    found = {}
    for i, loop in enumerate(loops):
        every = int(rng.choice([1, 1, 1, 2]))
        op, pv, sp = (s[i, _WARM::every].copy() for s in (signals.op, signals.pv, signals.sp))
        for _ in range(int(rng.integers(0, 3))):
            hole = int(rng.integers(0, pv.size - 40))
            pv[hole : hole + int(rng.integers(3, 30))] = np.nan
        found[names[i]] = LoopRecord(
            names[i], (source,) if i == origin else (), op, pv, sp, np.ones(op.size, dtype=bool),
            float(every), (loop.kc, loop.ti, loop.td), float(np.std(loop.noise)), math.nan, "",
        )  # fmt: skip
    return EventRecord(
        name=name,
        plant=plant,
        source=source,
        origin=None if origin is None else names[origin],
        members=tuple(names[i] for i in members),
        cascades=tuple((names[int(o)], names[s]) for s, o in enumerate(master) if o >= 0),
        loops=found,
    )
