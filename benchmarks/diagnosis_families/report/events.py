"""Plant-wide events of the report family: plants as graphs of flows between 6 to 40 loops."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.diagnosis_families.records import EventRecord, Floats, LoopRecord
from benchmarks.diagnosis_families.report.network import Put, Unit, run
from benchmarks.diagnosis_families.report.parts import Plant
from benchmarks.diagnosis_families.report.singles import draw_plant

__all__ = ["PLANTS", "draw_event"]

PLANTS = ("recycle", "cascade", "exchangers", "header")
_WARM = 300
_TRIES = 200
_LOOPS = (6, 40)
_USERS = 12
"""Most loops at a header: of more, none is felt by another."""
_VISIBLE = 0.8
"""A loop swings with the event where it makes this share of the error's usual deviation."""


def draw_event(plant: str, source: str, seed: int, samples: int = 3000) -> EventRecord:
    """Return a plant with an event from ``source``; the same arguments give the same plant."""
    key = zlib.crc32(f"report {plant} {source}".encode())
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, key, attempt])
        found = _draw(plant, source, rng, samples, f"{plant}-{source}-{seed}")
        if found is not None:
            return found
    raise RuntimeError(f"no sensible plant for {plant} {source} {seed} in {_TRIES} draws")


def _units(plant: str, rng: np.random.Generator) -> tuple[list[Unit], Floats, Floats]:
    """Healthy loops, and what of the flow of each reaches which other, after which lag."""
    most = _USERS if plant == "header" else _LOOPS[1]
    m = round(math.exp(rng.uniform(math.log(_LOOPS[0]), math.log(most))))
    units = []
    share, lag = np.zeros((m, m)), rng.uniform(1.0, 15.0, (m, m))
    size = rng.uniform(0.35, 0.9, m) * rng.choice([-1.0, 1.0], m)
    for i in range(m):
        process = draw_plant(rng, level=bool(rng.random() < 0.1))
        units.append(Unit(process, *process.simc(float(rng.uniform(1.2, 2.0)))))
        if plant == "recycle" and i:
            share[i, i - 1] = size[i]
        elif plant == "exchangers" and i:
            share[i, int(rng.integers(i))] = size[i]
        elif plant == "cascade" and i >= 2 and i % 2 == 0:
            share[i, i - 2] = size[i]
    if plant == "recycle":
        share[0, m - 1], lag[0, m - 1] = 0.2, 20.0
    if plant == "header":
        # users of different size; together they may not take more than the header gives
        share[:], lag[:] = -0.8 * rng.dirichlet(np.full(m, 0.7)), 2.0
        np.fill_diagonal(share, 0.0)
    if plant == "cascade":
        for i in range(0, m - 1, 2):
            inner = Plant(1.0, float(rng.uniform(2.0, 5.0)), 0.3, 0.5, False)
            units[i] = Unit(inner, *inner.simc(1.5))
            outer = units[i + 1].plant
            outer = Plant(outer.gain, outer.first, outer.second, outer.dead + 3.0, outer.level)
            units[i + 1] = Unit(outer, *outer.simc(2.0), master_of=i)
    return units, share, lag


def _put_in(
    plant: str, source: str, units: list[Unit], share: Floats, rng: np.random.Generator
) -> tuple[list[Unit], Floats, int | None, NDArray[np.float64]]:
    """The faulty loops, their flows, the source, and the size of the outside wave in each."""
    m = len(units)
    units = list(units)
    waves = np.zeros(m)
    k = int(rng.integers(m))
    if source == "sticky_valve":
        # of a cascade, the slave moves the valve
        k = units[k].master_of if units[k].master_of >= 0 else k
        stick = float(rng.uniform(5.0, 14.0))
        units[k] = replace(units[k], stick=stick, jump=stick * float(rng.uniform(0.25, 0.95)))
        return units, share, k, waves
    if source == "tight_tuning":
        if plant == "cascade" and units[k].master_of < 0:
            # a fast slave's ringing reaches nobody: its master is tuned tight
            k = min(k + 1, m - 1)
        # the slave is part of what a master controls, and not of its plant: less is left
        margin = float(rng.uniform(1.05, 1.5) if plant == "cascade" else rng.uniform(1.02, 1.1))
        units[k] = replace(units[k], kc=units[k].plant.ultimate(units[k].ti) / margin)
        return units, share, k, waves
    if source == "outside":
        hit = list(range(m)) if plant == "header" else [k]
        waves[hit] = rng.uniform(3.0, 8.0, len(hit)) * rng.choice([-1.0, 1.0], len(hit))
        return units, share, None, waves
    # up to two loops swing alone: nothing reaches their neighbours
    share = share.copy()
    alone = [i for i in range(m) if units[i].master_of < 0 and not _is_slave(i, units)]
    for i in rng.choice(alone, min(len(alone), int(rng.integers(0, 3))), replace=False):
        share[:, int(i)] = 0.0
        units[int(i)] = replace(units[int(i)], stick=8.0, jump=5.0)
    return units, share, None, waves


def _is_slave(i: int, units: list[Unit]) -> bool:
    return any(unit.master_of == i for unit in units)


def _draw(
    plant: str, source: str, rng: np.random.Generator, samples: int, name: str
) -> EventRecord | None:
    calm, share, lag = _units(plant, rng)
    m, n = len(calm), samples + _WARM
    faulty, joined, origin, waves = _put_in(plant, source, calm, share, rng)
    period = float(rng.uniform(35.0, 130.0))
    phase = np.cumsum(2.0 * math.pi / period + 0.008 * rng.standard_normal(n))
    load = lfilter([0.15], [1.0, -0.98], rng.standard_normal((m, n)), axis=1)
    quiet_noise = np.array([min(0.05 * abs(u.plant.gain), 0.2 / abs(u.kc)) for u in calm])
    noise = quiet_noise[:, None] * rng.standard_normal((m, n))
    wave = waves[:, None] * np.sin(phase)
    op, pv, sp = (x[:, _WARM:] for x in run(faulty, Put(load + wave, noise, joined, lag)))
    usual = [x[:, _WARM:] for x in run(calm, Put(load, noise, joined, lag))]
    if not np.isfinite(pv).all() or np.mean((op < 0.5) | (op > 99.5)) > 0.002:
        return None
    members: list[int] = []
    if source != "none":
        error = (usual[2] - usual[1]).std(axis=1)
        made = (pv - usual[1]).std(axis=1)
        members = [i for i in range(m) if made[i] > _VISIBLE * error[i]]
        if len(members) < 2 or (origin is not None and origin not in members):
            return None
    names = [f"TIC{i + 1:02d}" for i in range(m)]
    loops = {}
    for i, label in enumerate(names):
        every = int(rng.choice([1, 1, 2]))
        readings = pv[i, ::every].copy()
        for _ in range(int(rng.integers(0, 2))):
            at = int(rng.integers(0, readings.size - 30))
            readings[at : at + 20] = np.nan
        loops[label] = LoopRecord(
            label, (source,) if i == origin else (), op[i, ::every], readings, sp[i, ::every],
            np.ones(readings.size, dtype=bool), float(every),
            (faulty[i].kc, faulty[i].ti, 0.0), float(quiet_noise[i]), period, "",
        )  # fmt: skip
    return EventRecord(
        name, plant, source, None if origin is None else names[origin],
        tuple(names[i] for i in members),
        tuple((names[i], names[u.master_of]) for i, u in enumerate(calm) if u.master_of >= 0),
        loops,
    )  # fmt: skip
