"""Compiled loops over the hypotheses of one tracker: what a command and what a PV makes of them.

A hypothesis is a row of ``values``, whose columns are named here, and the same row of ``points``:
the process state and the errors of a `Belief`. Sums are taken in the order that is written, as in
`compensator.kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compensator.kernels import next_state, weighted_mean, weighted_spread
from compensator.stem_tracking.belief import ERRORS, FRICTION, GAIN, LOAD
from compiled import kernel_for

__all__ = [
    "COLUMNS",
    "DIRECTION",
    "DOUBT",
    "DOUBTFUL",
    "FARTHEST",
    "KEPT",
    "NEAREST",
    "NEGLIGIBLE",
    "NOISE",
    "PRIOR",
    "SCORE",
    "STEM",
    "SURVIVED",
    "TESTED",
    "TURN",
    "WAY",
    "chance_of_rest",
    "correct",
    "keep_likely",
    "log_chance_of_claim",
    "move",
]

Array = NDArray[np.float64]

STEM, DIRECTION, NOISE, SCORE, PRIOR, SURVIVED, TESTED, WAY, TURN = range(9)
"""Columns of ``values``: position; direction of the last slip (0: unknown); equation noise seen in
this scan's PV; log-likelihood of what was seen, forgetting, plus the prior; log-probability of the
friction claimed; largest command withstood, in deviations of the static friction around fS (minus
infinity: none near it), which fades with each slip; the same since the last slip; position and
direction that this scan's slip changed by.
"""
COLUMNS = TURN + 1
NEAREST, FARTHEST, DOUBT, DOUBTFUL, KEPT, NEGLIGIBLE = range(6)
"""Entries of ``law``: fields of `FrictionPrior`, and `TrackerSettings.negligible`."""


@kernel_for("float64(float64, float64[::1])")
def _chance_beyond(z: float, law: Array) -> float:
    """Return the probability that the static friction is more than ``z`` deviations above fS."""
    certain = 0.5 * math.erfc(z / math.sqrt(2.0))
    doubtful = 0.5 * math.erfc(z / law[DOUBTFUL] / math.sqrt(2.0))
    return float((1.0 - law[DOUBT]) * certain + law[DOUBT] * doubtful)


@kernel_for("float64(float64, float64, float64[::1])")
def chance_of_rest(z: float, tested: float, law: Array) -> float:
    """Return the probability that the stem withstands a command at ``z``, having withstood one at
    ``tested`` since its last slip (deviations of the static friction around fS).
    """
    if z > law[FARTHEST]:
        return 0.0
    if z <= tested or z < law[NEAREST]:
        return 1.0
    withstood = _chance_beyond(tested, law)
    return min(1.0, _chance_beyond(z, law) / withstood) if withstood > 0.0 else 1.0


@kernel_for("float64(float64, float64[::1])")
def log_chance_of_claim(claim: float, law: Array) -> float:
    """Return the log-probability of a static friction at least ``claim`` deviations above fS; a
    claim below fS costs nothing.
    """
    return math.log(max(_chance_beyond(claim, law), 1e-30)) if claim > 0.0 else 0.0


@kernel_for("void(float64[::1], float64[::1])")
def _charge(row: Array, law: Array) -> None:
    """Charge what is unlikely of the friction claimed, once."""
    prior = log_chance_of_claim(row[SURVIVED], law)
    row[SCORE] += prior - row[PRIOR]
    row[PRIOR] = prior


@kernel_for(
    "int64(float64[:, ::1], float64[:, ::1], int64, float64[:, ::1], float64[:, ::1], float64,"
    " float64, float64, float64, float64[::1], float64[:, ::1], float64[::1], float64[::1])"
)
def _outcomes(
    values: Array,
    points: Array,
    count: int,
    new_values: Array,
    new_points: Array,
    op: float,
    static: float,
    dynamic: float,
    deviation: float,
    law: Array,
    A: Array,
    B: Array,
    noise_gain: Array,
) -> int:
    """Write what ``op`` may have made of each hypothesis; return how many there are now."""
    n = B.size
    made = 0
    for h in range(count):
        row, point = values[h], points[h]
        free = next_state(A, point)
        for i in range(n):
            free[i] += noise_gain[i] * row[NOISE]
        error = op - row[STEM]
        side = math.copysign(1.0, error)
        z = (abs(error) - static) / deviation
        stays = chance_of_rest(z, row[TESTED], law)
        for slips in range(2):
            if (slips == 0 and stays <= law[NEGLIGIBLE]) or (
                slips == 1 and stays >= 1.0 - law[NEGLIGIBLE]
            ):
                continue
            new, at = new_values[made], new_points[made]
            new[:] = row
            at[n:] = point[n:]
            new[NOISE] = new[WAY] = new[TURN] = 0.0
            if slips == 0:
                new[SCORE] += math.log(stays)
                if z > law[NEAREST]:
                    new[SURVIVED] = max(row[SURVIVED], z)
                    new[TESTED] = max(row[TESTED], z)
            else:
                new[SCORE] += math.log(1.0 - stays)
                new[STEM], new[DIRECTION] = op - side * dynamic, side
                new[WAY] = new[STEM] - row[STEM]
                new[TURN] = side - row[DIRECTION]
                claimed = row[SURVIVED]
                new[SURVIVED] = law[KEPT] * claimed if claimed > 0.0 else -np.inf
                new[TESTED] = -np.inf
                # The load takes up what the errors of fD and of the gain make of the slip.
                load, wrong, gain = point[n + LOAD], point[n + FRICTION], point[n + GAIN]
                at[n + LOAD] = load + wrong * new[TURN] + gain * new[WAY]
            _charge(new, law)
            drive = new[STEM] + at[n + LOAD]
            for i in range(n):
                at[i] = free[i] + B[i] * drive
            made += 1
    return made


@kernel_for("Tuple((float64[::1], float64[:, ::1]))(float64[:, ::1], float64[:, ::1], int64[::1])")
def _group(values: Array, points: Array, members: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return weights (the likeliest has 1) and points of some hypotheses."""
    top = values[members[0], SCORE]
    for h in members:
        top = max(top, values[h, SCORE])
    weights = np.empty(members.size)
    chosen = np.empty((members.size, points.shape[1]))
    for k in range(members.size):
        weights[k] = math.exp(values[members[k], SCORE] - top)
        chosen[k] = points[members[k]]
    return weights, chosen


@kernel_for(
    "int64(float64[:, ::1], float64[:, ::1], int64, float64[:, ::1], float64[:, ::1], int64[::1])"
)
def _merge(
    values: Array,
    points: Array,
    count: int,
    new_values: Array,
    new_points: Array,
    group_of: NDArray[np.int64],
) -> int:
    """Write one hypothesis for each position; return how many there are, and in ``group_of`` which
    of them each has become.

    After a certain slip several hypotheses stand at one position, each with its own load. The
    likeliest goes on with the mean of state and errors and the score of all of them.
    """
    groups = 0
    for h in range(count):
        group_of[h] = groups
        for g in range(groups):
            if new_values[g, STEM] == values[h, STEM]:
                group_of[h] = g
                break
        if group_of[h] == groups:
            new_values[groups, STEM] = values[h, STEM]
            groups += 1
    for g in range(groups):
        members = np.flatnonzero(group_of[:count] == g)
        top = members[0]
        for k in range(1, members.size):
            if values[members[k], SCORE] > values[top, SCORE]:
                top = members[k]
        new_values[g] = values[top]
        new_points[g] = points[top]
        if members.size > 1:
            weights, chosen = _group(values, points, members)
            total, mean = weighted_mean(chosen, weights)
            new_points[g] = mean
            new_values[g, SCORE] += math.log(total)
    return groups


@kernel_for("Tuple((int64, int64[::1]))(float64[:, ::1], int64, float64, float64, int64)")
def _likely(
    values: Array, count: int, alike: float, hopeless: float, most: int
) -> tuple[int, NDArray[np.int64]]:
    """Return how many hypotheses are kept, and their rows, best first."""
    order = np.empty(count, dtype=np.int64)
    for h in range(count):
        place = h
        while place > 0 and values[order[place - 1], SCORE] < values[h, SCORE]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = h
    if values[0, SCORE] > values[order[0], SCORE] - alike:
        place = 0
        while order[place] != 0:
            place += 1
        while place > 0:
            order[place] = order[place - 1]
            place -= 1
        order[0] = 0
    least = values[order[0], SCORE] - hopeless
    kept = 0
    for place in range(count):
        h = order[place]
        if values[h, SCORE] < least or kept == most:
            break
        known = False
        for k in range(kept):
            known = known or values[order[k], STEM] == values[h, STEM]
        if not known:
            order[kept] = h
            kept += 1
    return kept, order


@kernel_for(
    "Tuple((int64, int64))(float64[:, ::1], float64[:, ::1], int64, float64, float64, int64)"
)
def keep_likely(
    values: Array, points: Array, count: int, alike: float, hopeless: float, most: int
) -> tuple[int, int]:
    """Keep the best few, best first: none hopeless, one of a position.

    The first one stays the first while no other is plainly likelier: at rest PV tells none from
    another, and an OP that went from the middle of one band to that of another would set off a
    stem that stands in a third.

    Args:
        values, points: the hypotheses, in their first ``count`` rows; written.
        alike: difference of log-likelihoods that tells nothing.
        hopeless: difference to the first beyond which a hypothesis is dropped.
        most: hypotheses that are kept at most.

    Returns:
        How many there are now, and the row where the first one was.
    """
    kept, order = _likely(values, count, alike, hopeless, most)
    same = True
    for k in range(kept):
        same = same and order[k] == k
    if not same:
        values[:kept] = values[order[:kept]]
        points[:kept] = points[order[:kept]]
    return kept, order[0]


@kernel_for(
    "Tuple((int64, boolean))(float64[:, ::1], float64[:, ::1], int64, float64, float64, float64,"
    " float64, float64[::1], float64[:, ::1], float64[::1], float64[::1], float64, float64, int64,"
    " float64[:, ::1])"
)
def move(
    values: Array,
    points: Array,
    count: int,
    op: float,
    static: float,
    dynamic: float,
    deviation: float,
    law: Array,
    A: Array,
    B: Array,
    noise_gain: Array,
    alike: float,
    hopeless: float,
    most: int,
    spread: Array,
) -> tuple[int, bool]:
    """Go on by one scan under ``op``: the stem of each hypothesis stays, or slips, or both.

    Args:
        values, points: the hypotheses, in their first ``count`` rows; written. They have room for
            twice as many.
        op: applied since the last scan.
        static, dynamic: friction of the valve, in OP; deviation: of the static one.
        law: of the friction.
        A, B, noise_gain: the process in observer form, and how equation noise enters it.
        alike, hopeless, most: see `keep_likely`.
        spread: of those that were merged into the best one, shape ``(n + 3, n + 3)``: what it adds
            to the covariance; written if there were any.

    Returns:
        How many hypotheses there are now, and whether others were merged into the best one.
    """
    made_values = np.empty((2 * count, values.shape[1]))
    made_points = np.empty((2 * count, points.shape[1]))
    made = _outcomes(
        values, points, count, made_values, made_points,
        op, static, dynamic, deviation, law, A, B, noise_gain,
    )  # fmt: skip
    group_of = np.empty(made, dtype=np.int64)
    groups = _merge(made_values, made_points, made, values, points, group_of)
    kept, first = keep_likely(values, points, groups, alike, hopeless, most)
    members = np.flatnonzero(group_of == first)
    if members.size > 1:
        weights, chosen = _group(made_values, made_points, members)
        spread[:] = weighted_spread(chosen, weights, points[0])
    return kept, members.size > 1


@kernel_for(
    "Tuple((int64, float64))(float64[:, ::1], float64[:, ::1], int64, float64, float64, float64,"
    " float64[::1], float64, float64, float64, float64, float64, float64, float64, int64)"
)
def correct(
    values: Array,
    points: Array,
    count: int,
    pv: float,
    innovation: float,
    farthest: float,
    gain: Array,
    carried: float,
    memory: float,
    largest_friction: float,
    least_gain: float,
    largest_gain: float,
    alike: float,
    hopeless: float,
    most: int,
) -> tuple[int, float]:
    """Take in PV.

    Args:
        values, points: the hypotheses, in their first ``count`` rows; written.
        pv: of this scan; innovation: its expected variance; farthest: largest surprise counted.
        gain: of the filter, shape ``(n + 3,)``.
        carried: share of the surprise that goes on as equation noise.
        memory: scans over which evidence counts.
        largest_friction: bound of the error of fD, in OP.
        least_gain, largest_gain: bounds of the error of the gain.
        alike, hopeless, most: see `keep_likely`.

    Returns:
        How many hypotheses there are now, and the surprise of the best one.
    """
    surprises, evidence = np.empty(count), np.empty(count)
    for h in range(count):
        surprises[h] = min(max(pv - points[h, 0], -farthest), farthest)
        # Heavy tails: one wild sample must not decide between two positions.
        evidence[h] = -0.5 * min(surprises[h] * surprises[h] / innovation, 9.0)
    best, worst = evidence.max(), evidence.min()
    # A PV that all hypotheses expected alike tells nothing, and lets nothing be forgotten:
    # otherwise all of them are likely again after a long rest.
    keep = 1.0 - (1.0 - math.exp(worst - best)) / memory
    n = points.shape[1] - ERRORS
    for h in range(count):
        row, point = values[h], points[h]
        for i in range(gain.size):
            point[i] += gain[i] * surprises[h]
        wrong, error = point[n + FRICTION], point[n + GAIN]
        point[n + FRICTION] = min(max(wrong, -largest_friction), largest_friction)
        point[n + GAIN] = min(max(error, least_gain), largest_gain)
        row[NOISE] = carried * surprises[h]
        row[SCORE] = row[PRIOR] + keep * (row[SCORE] - row[PRIOR]) + (evidence[h] - best)
    kept, first = keep_likely(values, points, count, alike, hopeless, most)
    return kept, surprises[first]
