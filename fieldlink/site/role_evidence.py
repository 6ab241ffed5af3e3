"""Which of two signals is the controller's output: what the data themselves tell.

    judge_roles(op, pv).sentence      # "moves 8 samples before PV, PV follows; stays in 0 to 100"

OP is a percentage, so it stays in 0 to 100, and it moves first: PV follows through valve and
process. While a controller is at work, OP moves with every change of PV in the same sample, because
it is computed from PV; so "first" is asked of steps that begin while the other signal is at rest,
and where there are none, of which signal the other one is computed from. What is not clear is left
unclear: a person decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

__all__ = ["HIGHEST", "LOWEST", "RoleEvidence", "Roles", "judge_roles"]

Floats = NDArray[np.float64]

LOWEST, HIGHEST = -5.0, 105.0
"""Range of an OP in per cent: a signal of 4 to 20 mA may be 5 % outside of its span (NAMUR NE 43
tells a broken wire from 3.6 and 21 mA, -2.5 % and 106 %)."""

FEWEST = 50
"""Samples below which no role is found: fewer hold one movement of a loop or none."""

EXACT = 0.1
"""Share of a signal's changes left unexplained by the other's present and last values, up to which
it is computed from them. A PI controller leaves rounding; a process that is measured leaves noise,
the valve, and its own memory."""

CLEAR = 2.0
"""Ratio of two such shares from which the smaller one decides. Of 400 simulated loops (PI, valves
that stick or not, gains of both signs, rounding, noise) these three limits decide 174, none of them
the wrong way round; the test runs some of those loops."""

STEPS_CLEAR = 3.0
"""Ratio of the movements after and before the steps of a signal that is moved by hand."""

PASSES = 8
"""Fits of which each leaves out the rows that fit worst in the one before."""

LEFT_OUT = 0.2
"""Share of the rows that is left out: `REACH` rows around each set-point step, and limits."""

REACH = 8
"""Samples: long enough to move, short beside the time between two set-point steps."""

LIVELY = 0.01
"""Share that the usual movement of a signal has of its greatest, below which a few steps of the
set-point are all that can be seen, and the process answers them as exactly as a controller."""

AT_REST = 0.5
"""Share of samples without any change, from which a signal is moved by hand."""


class Roles(Enum):
    """What the data say of two signals that are taken for OP and PV."""

    AGREE = "agree"
    SWAPPED = "swapped"
    UNCLEAR = "unclear"


@dataclass(frozen=True, slots=True)
class RoleEvidence:
    """What was found, with the reason in words."""

    roles: Roles
    sentence: str


def judge_roles(op: Floats, pv: Floats) -> RoleEvidence:
    """Say whether ``op`` is the controller's output and ``pv`` what it controls.

    Args:
        op, pv: equally spaced samples of one length, NaN where one is missing.
    """
    whole = np.isfinite(op) & np.isfinite(pv)
    op, pv = np.asarray(op, float)[whole], np.asarray(pv, float)[whole]
    if op.size < FEWEST:
        return RoleEvidence(Roles.UNCLEAR, f"only {op.size} samples, {FEWEST} are needed")
    inside = [bool(x.min() >= LOWEST and x.max() <= HIGHEST) for x in (op, pv)]
    if inside == [False, True]:
        said = f"OP goes from {op.min():.4g} to {op.max():.4g}, an OP stays in 0 to 100"
        return RoleEvidence(Roles.SWAPPED, said)
    if not inside[0]:
        said = f"neither stays in 0 to 100: OP goes from {op.min():.4g} to {op.max():.4g}"
        return RoleEvidence(Roles.UNCLEAR, said)
    moves = [np.diff(x) for x in (op, pv)]
    if not all(np.any(move) for move in moves):
        names = [name for name, move in zip(("OP", "PV"), moves, strict=True) if not np.any(move)]
        return RoleEvidence(Roles.UNCLEAR, f"{' and '.join(names)} stood still")
    for held, other, roles, sentence in (
        (op, pv, Roles.AGREE, "OP is moved in steps and PV follows"),
        (pv, op, Roles.SWAPPED, "PV is moved in steps and OP follows"),
    ):
        if _is_at_rest(held) and not _is_at_rest(other) and _follows(held, other):
            return RoleEvidence(roles, sentence)
    if min(_liveliness(op), _liveliness(pv)) < LIVELY:
        return RoleEvidence(Roles.UNCLEAR, "the loop is at rest for most of the time")
    left = [_left_over(op, pv), _left_over(pv, op)]
    if min(left) <= EXACT and max(left) >= CLEAR * min(left):
        if left[0] < left[1]:
            return RoleEvidence(Roles.AGREE, "OP is computed from PV as a controller does")
        return RoleEvidence(Roles.SWAPPED, "PV is computed from OP as a controller does")
    return RoleEvidence(Roles.UNCLEAR, "the data do not tell which of the two moves first")


def _is_at_rest(signal: Floats) -> bool:
    return float(np.mean(np.diff(signal) == 0.0)) >= AT_REST


def _follows(held: Floats, other: Floats) -> bool:
    """Whether the other signal moves more after the steps of one than before them."""
    steps = np.flatnonzero(np.diff(held) != 0.0)
    after, before = [], []
    for step in steps:
        if 2 * REACH <= step < held.size - 2 * REACH:
            change = np.sign(held[step + 1] - held[step])
            after.append(change * (other[step + 2 * REACH] - other[step]))
            before.append(change * (other[step] - other[step - 2 * REACH]))
    return bool(after) and abs(float(np.mean(after))) > STEPS_CLEAR * abs(float(np.mean(before)))


def _left_over(signal: Floats, other: Floats) -> float:
    """Return the share of a signal that the rule of a PI controller on the other leaves over.

    Its output changes by a multiple of its input's change and of its input's sum. Compared are
    changes over `REACH` samples, which are large beside rounding, with those just before, which
    cancels the set-point. Least squares on all rows but those that fit worst, found in a few
    passes: set-point steps and changes by hand are not computed from the other signal.
    """

    changes = _turns(signal)
    rows = np.column_stack([_turns(other), _turns(np.cumsum(other))])
    kept = np.ones(changes.size, bool)
    rest = changes
    for _ in range(PASSES):
        found, *_ = np.linalg.lstsq(rows[kept], changes[kept], rcond=None)
        rest = np.abs(changes - rows @ found)
        kept = rest <= np.quantile(rest, 1.0 - LEFT_OUT)
    size = float(np.mean(np.abs(changes[kept])))
    return float(np.mean(rest[kept])) / size if size > 0.0 else 1.0


def _turns(values: Floats) -> Floats:
    """Return how the change over `REACH` samples differs from the one just before."""
    change = values[REACH:] - values[:-REACH]
    turns: Floats = change[REACH:] - change[:-REACH]
    return turns


def _liveliness(signal: Floats) -> float:
    """Return how much usually happens in a signal, as a share of the most that happens."""
    sizes = np.abs(_turns(signal))
    most = float(sizes.max())
    return float(np.median(sizes)) / most if most > 0.0 else 0.0
