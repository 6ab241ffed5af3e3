"""Loops whose OP moves in steps, with a hand that takes over, and at limits: no mode is recorded.

A controller's output dead band, a three-point actuator, a coarse output and a historian that stores
by exception all let OP stand still while the controller is in automatic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.diagnosis_families.records import Floats

__all__ = ["KINDS", "HandRecord", "draw_hand"]

KINDS = ("continuous", "dead band", "three-point", "coarse", "by exception")
"""How OP moves."""
_WARM = 300
_LEAST_FREE = 100


@dataclass(frozen=True, slots=True)
class HandRecord:
    """One loop as recorded, ``(n,)`` each, and the samples in which a hand or a limit holds OP."""

    op: Floats
    pv: Floats
    sp: Floats
    by_hand: NDArray[np.bool_]
    limited: NDArray[np.bool_]


@dataclass(slots=True)
class _Output:
    """What a controller's output becomes."""

    kind: str
    step: float
    at: float = 50.0

    def move(self, wanted: float) -> float:
        away = wanted - self.at
        if self.kind == "dead band" and abs(away) >= self.step:
            self.at = wanted
        elif self.kind == "three-point" and abs(away) > self.step:
            self.at += math.copysign(min(self.step, abs(away)), away)
        elif self.kind == "coarse":
            self.at = round(wanted / self.step) * self.step
        elif self.kind in ("continuous", "by exception"):
            self.at = wanted
        return self.at


def draw_hand(
    kind: str, seed: int, *, share: float = 0.0, moves: int = 0, limit: bool = False, n: int = 1200
) -> HandRecord:
    """A loop of that kind.

    Args:
        kind: one of `KINDS`.
        seed: the same arguments give the same loop.
        share: of the record, by hand at one stretch; OP is then moved that many times (``moves``).
        limit: whether OP reaches a limit that the load asks it to pass.
        n: samples.
    """
    rng = np.random.default_rng([KINDS.index(kind), seed, int(1000 * share), moves, limit])
    total = n + _WARM
    lag, dead = float(np.exp(rng.uniform(np.log(4.0), np.log(40.0)))), int(rng.integers(1, 9))
    gain = float(np.exp(rng.uniform(np.log(0.4), np.log(2.5))) * rng.choice([-1.0, 1.0]))
    closed = (dead + 1.0) * rng.uniform(1.0, 2.0)
    kc, ti = lag / (closed + dead + 1.0) / gain, min(lag, 4.0 * (closed + dead + 1.0))
    pole, red = math.exp(-1.0 / lag), math.exp(-1.0 / rng.uniform(10.0, 80.0))
    drawn = rng.standard_normal((2, total))
    noise = min(abs(gain) * rng.uniform(0.03, 0.2), 0.3 / abs(kc)) * drawn[0]
    load, size = np.zeros(total), rng.uniform(0.7, 2.0)
    for k in range(1, total):
        load[k] = red * load[k - 1] + size * math.sqrt(1.0 - red * red) * drawn[1, k]
    high = 100.0
    if limit:
        push = rng.uniform(8.0, 15.0) * np.sin(2.0 * math.pi * np.arange(total) / (0.4 * n))
        load, high = load - push, 50.0 + rng.uniform(3.0, 6.0)
    start = _WARM + int(rng.uniform(_LEAST_FREE, max(_LEAST_FREE + 1, n * (1.0 - share))))
    by_hand = np.zeros(total, dtype=bool)
    by_hand[start : start + round(share * n)] = True
    changes = set(rng.integers(start, start + max(1, round(share * n)), moves).tolist())
    output = _Output(kind, float(rng.uniform(0.3, 1.2)))
    op, pv = np.empty(total), np.empty(total)
    wanted, hand, y, last = 50.0, 50.0, 0.0, 0.0
    for k in range(total):
        pv[k] = y + noise[k]
        error = -pv[k]
        wanted = min(wanted + kc * (error - last) + kc / ti * error, high)
        last = error
        if by_hand[k]:
            if k in changes:
                hand += rng.uniform(1.0, 5.0) * rng.choice([-1.0, 1.0])
            wanted = hand = min(hand, high)
            op[k] = output.at = hand
        else:
            op[k] = hand = output.move(wanted)
        flow = op[max(0, k - dead)] - 50.0 + load[k]
        y = pole * y + (1.0 - pole) * gain * flow
    limited = ~by_hand & (op >= high - output.step * (kind != "continuous")) & limit
    if kind == "by exception":
        op = _stored(op, output.step)
    rows = slice(_WARM, None)
    return HandRecord(op[rows], pv[rows], np.zeros(n), by_hand[rows], limited[rows])


def _stored(op: Floats, step: float) -> Floats:
    """What a historian holds that stores a value once it has changed by so much."""
    out = op.copy()
    for k in range(1, op.size):
        if abs(out[k] - out[k - 1]) < step:
            out[k] = out[k - 1]
    return out
