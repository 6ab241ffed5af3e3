"""Plant-wide events of the report family: plants as graphs of flows between loops."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np

from benchmarks.diagnosis_families.records import EventRecord, Floats, LoopRecord
from benchmarks.diagnosis_families.report.parts import Controller, Plant, Sensor, Valve
from benchmarks.diagnosis_families.report.singles import draw_plant

__all__ = ["PLANTS", "draw_event"]

PLANTS = ("recycle", "cascade", "exchangers", "header")
_WARM = 300
_TRIES = 100


@dataclass
class _Unit:
    """A loop of the plant and what flows into it: ``(from, share, lag)``."""

    plant: Plant
    kc: float
    ti: float
    inlets: list[tuple[int, float, float]]
    valve: Valve
    wave: float = 0.0
    slave: int | None = None


def draw_event(plant: str, source: str, seed: int, samples: int = 1800) -> EventRecord:
    """The plant of that kind, source and seed; the same arguments give the same plant."""
    key = zlib.crc32(f"report {plant} {source}".encode())
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, key, attempt])
        found = _draw(plant, source, rng, samples, f"{plant}-{source}-{seed}")
        if found is not None:
            return found
    raise RuntimeError(f"no sensible plant for {plant} {source} {seed} in {_TRIES} draws")


def _units(plant: str, rng: np.random.Generator) -> list[_Unit]:
    m = int(rng.integers(6, 13))
    units = []
    for i in range(m):
        p = draw_plant(rng, level=bool(rng.random() < 0.1))
        kc, ti = p.simc(float(rng.uniform(1.2, 2.0)))
        units.append(_Unit(p, kc, ti, [], Valve()))
        lag = float(rng.uniform(1.0, 15.0))
        share = float(rng.uniform(0.35, 0.9) * rng.choice([-1.0, 1.0]))
        if plant == "recycle" and i:
            units[i].inlets.append((i - 1, share, lag))
        elif plant == "exchangers" and i:
            units[i].inlets.append((int(rng.integers(i)), share, lag))
        elif plant == "cascade" and i >= 2 and i % 2 == 0:
            units[i].inlets.append((i - 2, share, lag))
    if plant == "recycle":
        units[0].inlets.append((m - 1, 0.2, 20.0))
    if plant == "header":
        for i, unit in enumerate(units):
            unit.inlets = [(j, -1.6 / m, 2.0) for j in range(m) if j != i]
    if plant == "cascade":
        for i in range(0, m - 1, 2):
            inner = Plant(1.0, float(rng.uniform(2.0, 5.0)), 0.3, 0.5, False)
            kc, ti = inner.simc(1.5)
            units[i].plant, units[i].kc, units[i].ti = inner, kc, ti
            units[i + 1].slave = i
            outer = units[i + 1].plant
            outer.dead += 3.0
            units[i + 1].kc, units[i + 1].ti = outer.simc(2.0)
    return units


def _draw(
    plant: str, source: str, rng: np.random.Generator, samples: int, name: str
) -> EventRecord | None:
    state = rng.integers(2**32)
    layout = int(rng.integers(2**32))

    def built(faulty: bool) -> tuple[list[_Unit], int | None, list[int]]:
        inner = np.random.default_rng(layout)
        units = _units(plant, inner)
        k = int(inner.integers(len(units)))
        if source == "sticky_valve" and units[k].slave is not None:
            # the slave moves the valve
            k = int(units[k].slave or 0)
        if source == "tight_tuning" and plant == "cascade" and units[k].slave is None:
            # a fast slave's ringing reaches nobody: its master is tuned tight
            k = min(k + 1, len(units) - 1)
        origin: int | None = k
        hit: list[int] = []
        if source == "sticky_valve" and faulty:
            stick = float(inner.uniform(5.0, 14.0))
            units[k].valve = Valve(stick=stick, jump=stick * float(inner.uniform(0.25, 0.95)))
        elif source == "tight_tuning" and faulty:
            p = units[k].plant
            units[k].kc = p.ultimate(units[k].ti) / float(inner.uniform(1.02, 1.1))
        elif source in ("outside", "none"):
            origin = None
            if source == "outside" and faulty:
                hit = list(range(len(units))) if plant == "header" else [k]
                for i in hit:
                    units[i].wave = float(inner.uniform(3.0, 8.0) * inner.choice([-1.0, 1.0]))
        return units, origin, hit

    units, origin, _ = built(faulty=True)
    period = float(rng.uniform(35.0, 130.0))
    calm, _, _ = built(faulty=False)
    swung = _run(units, samples, period, int(state))
    quiet = _run(calm, samples, period, int(state))
    op, pv, sp = swung
    if not np.isfinite(pv).all() or np.mean((op < 0.5) | (op > 99.5)) > 0.002:
        return None
    members: list[int] = []
    if source != "none":
        usual = (quiet[2] - quiet[1]).std(axis=1)
        made = (pv - quiet[1]).std(axis=1)
        members = [i for i in range(len(units)) if made[i] > 0.8 * usual[i]]
        if len(members) < 2 or (origin is not None and origin not in members):
            return None
    names = [f"TIC{i + 1:02d}" for i in range(len(units))]
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
            (units[i].kc, units[i].ti, 0.0), 0.0, period, "",
        )  # fmt: skip
    return EventRecord(
        name, plant, source, None if origin is None else names[origin],
        tuple(names[i] for i in members),
        tuple((names[i], names[u.slave]) for i, u in enumerate(units) if u.slave is not None),
        loops,
    )  # fmt: skip


def _run(units: list[_Unit], samples: int, period: float, state: int) -> tuple[Floats, ...]:
    rng = np.random.default_rng(state)
    m, n = len(units), samples + _WARM
    op, pv, sp = np.empty((m, n)), np.empty((m, n)), np.zeros((m, n))
    controllers = [Controller(u.kc, u.ti) for u in units]
    sensors = [
        Sensor(min(0.05 * abs(u.plant.gain), 0.2 / abs(u.kc)), np.random.default_rng(state + i + 1))
        for i, u in enumerate(units)
    ]
    y, load = np.zeros(m), np.zeros(m)
    reached = [[0.0] * len(u.inlets) for u in units]
    phase = 0.0
    for k in range(n):
        phase += 2.0 * math.pi / period + 0.008 * rng.standard_normal()
        load = 0.98 * load + 0.15 * rng.standard_normal(m)
        flows = np.empty(m)
        # masters first, so that a slave follows the set-point of its own sample
        for i in sorted(range(m), key=lambda i: units[i].slave is None):
            pv[i, k] = sensors[i].read(float(y[i]), k)
            master = next((j for j in range(m) if units[j].slave == i), None)
            if master is not None:
                sp[i, k] = op[master, k] - 50.0
            op[i, k] = controllers[i].step(float(sp[i, k]), float(pv[i, k]))
            flows[i] = units[i].valve.flow(float(op[i, k]))
        for i, unit in enumerate(units):
            into = flows[i] if unit.slave is None else float(y[unit.slave])
            into += load[i] + unit.wave * math.sin(phase)
            for j, (start, share, lag) in enumerate(unit.inlets):
                reached[i][j] += (flows[start] - reached[i][j]) / max(1.0, lag)
                into += share * reached[i][j]
            y[i] = unit.plant.step(float(into))
    return op[:, _WARM:], pv[:, _WARM:] + 30.0, sp[:, _WARM:] + 30.0
