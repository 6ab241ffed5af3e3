"""How likely PV is under a stem whose friction is another one at every slip; its likeliest path.

A stem at rest breaks away where OP is further from it than its static friction, and comes to stand
at its dynamic friction from OP; both are drawn anew at each slip. Between slips PV is a linear
system, so a path of the stem (when it slips, and which way) is followed by a Kalman filter whose
state is the stem, the process and what the noise model remembers. Paths branch wherever the stem
may slip, and the likeliest ones are kept: a bank of filters over a tree of paths (Blackman and
Popoli, Design and Analysis of Modern Tracking Systems, 1999, chapter 6).
"""

from __future__ import annotations

import math

import numpy as np

from compiled import kernel
from estimator.algebra import order_of
from estimator.arrays import Array, Index

__all__ = ["Frictions", "ProcessOfPaths", "follow_paths"]

Frictions = tuple[float, float, float, float, float]
"""Mean static and dynamic friction, their deviations, and the deviation of the share of a slip that
PV sees a sample late."""
ProcessOfPaths = tuple[tuple[float, float, float, float], tuple[float, float], int, float]
"""Coefficients of the poles, gains at the dead time and one sample later, the dead time, and the
variance of the innovations."""

_PATHS, _BEHIND = 12, 8.0
"""Paths that are kept, and nats by which one may be less likely than the best. Of simulated valves
whose friction varies 30 paths within 12 nats change what is found by a few nats of hundreds, and
take three times as long."""
_SURPRISE = 1e-6
"""Chance of a slip in a sample in which friction tells that there is none."""
_FAR = 4.0
"""Deviations from which a slip tells nothing of where the stem stood."""
_NEVER = 1e-12
"""Chance below which a tail of the normal distribution is taken for an exponential one."""
_STEM, _FIRST, _SLOW, _SLOWER, _OUT, _SEEN = range(6)
"""Places in the mean and covariance of a path: the stem now and before the window, the process (its
two main poles and the third), and what PV showed of it in the samples before."""
_WORTH, _HIGHEST, _LOWEST, _WAY, _LATENESS = range(5)
"""Places in the state of a path: its log-likelihood, OP's highest and lowest since the stem rests,
the way in which it slides (0 at rest), and the variance of what is late of its slip."""
_CHILDREN = 3
"""Paths that one may branch into: rest, slip up, slip down."""

_Bank = tuple[Array, Array, Array, Index]
"""Paths: means ``(m, s)``, covariances ``(m, s, s)``, states ``(m, 5)`` and their last events.

An event, where a stretch of rest or sliding begins, is the event before it, its row and whether the
stem slides from there on; beside it stands where the stem stood before."""


@kernel
def follow_paths(
    u: Array,
    target: Array,
    weight: Array,
    taps: Array,
    start: float,
    frictions: Frictions,
    process: ProcessOfPaths,
    quantum: float,
    slides: bool,
) -> tuple[float, Array]:
    """Log-likelihood of PV over all paths, without constants; and the stem of the likeliest.

    Rows before the dead time are not judged.

    Args:
        u: OP, ``(n,)``.
        target: PV without its columns, whitened, ``(n,)``.
        weight: 1 for a row that is judged, else 0, ``(n,)``.
        taps: the noise model, ``(p,)``.
        start: the stem before the window.
        frictions, process: see `Frictions` and `ProcessOfPaths`.
        quantum: step in which OP was recorded: the valve may have seen more.
        slides: whether a stem that broke away follows OP until OP stops or turns.
    """
    poles, gains, dead_time, variance = process
    n, size = u.size, _SEEN + max(taps.size, 1)
    forward, shown, late = _linear_system(poles, gains, taps, size)
    kept, new = _bank(_PATHS, size), _bank(_CHILDREN * _PATHS, size)
    room = np.empty((4, size))
    mean, cov, state, event = kept
    events = np.empty((_CHILDREN * _PATHS * n + 1, 3), np.int64)
    stood = np.empty(events.shape[0])
    events[0] = -1, 0, 0
    mean[0, _STEM] = mean[0, _FIRST] = start
    state[0, _HIGHEST] = state[0, _LOWEST] = u[0]
    paths = known = 1
    for row in range(n - dead_time):
        step = u[max(row - 1, 0)], u[row], quantum
        children, enough = 0, state[:paths, _WORTH].max() - _BEHIND
        for i in range(paths):
            if state[i, _WAY] * (u[row] - step[0]) > 0.0:
                _slide_on(kept, i, new, children, u[row] - step[0])
                children += 1
                continue
            if state[i, _WAY] != 0.0:
                # it stops where OP turned
                events[known], stood[known] = (event[i], row, 0), mean[i, _STEM]
                state[i, _HIGHEST] = state[i, _LOWEST] = step[0]
                state[i, _WAY], event[i] = 0.0, known
                known += 1
            for way, chance in _chances(mean[i], cov[i], state[i], step, frictions):
                worth = state[i, _WORTH] + math.log(chance) if chance > 0.0 else -np.inf
                if worth <= enough:
                    continue
                _copy(kept, i, new, children)
                new[2][children, _WORTH] = worth
                if way == 0.0:
                    _rest(new[2][children], u[row])
                else:
                    stood[known] = _slip(new, children, way, u[row], frictions, slides)
                    events[known] = event[i], row, int(slides)
                    new[3][children] = known
                    known += 1
                children += 1
        at = row + dead_time
        seen = target[at] if weight[at] != 0.0 else math.nan
        for i in range(children):
            lateness = new[2][i, _LATENESS]
            new[2][i, _WORTH] += _advance(
                new[0][i], new[1][i], forward, shown, late, lateness, seen, variance, room
            )
        paths = _keep_likeliest(new, children, kept)
    worth = state[0, _WORTH] + math.log(np.exp(state[:paths, _WORTH] - state[0, _WORTH]).sum())
    return worth, _stem_of_path(u, dead_time, mean[0, _STEM], event[0], events, stood)


@kernel
def _bank(paths: int, size: int) -> _Bank:
    """Room for so many paths."""
    mean, cov = np.zeros((paths, size)), np.zeros((paths, size, size))
    return mean, cov, np.zeros((paths, 5)), np.zeros(paths, np.int64)


@kernel
def _copy(source: _Bank, i: int, target: _Bank, j: int) -> None:
    """Put a path of one bank into another; nothing of its last slip is late any more."""
    target[0][j], target[1][j] = source[0][i], source[1][i]
    target[2][j], target[3][j] = source[2][i], source[3][i]
    target[2][j, _LATENESS] = 0.0


@kernel
def _keep_likeliest(new: _Bank, children: int, kept: _Bank) -> int:
    """Put the likeliest paths into the bank of those that are kept; how many they are."""
    paths, least = 0, new[2][:children, _WORTH].max() - _BEHIND
    for i in order_of(-new[2][:children, _WORTH]):
        if paths == _PATHS or new[2][i, _WORTH] < least:
            break
        kept[0][paths], kept[1][paths] = new[0][i], new[1][i]
        kept[2][paths], kept[3][paths] = new[2][i], new[3][i]
        paths += 1
    return paths


@kernel
def _slide_on(kept: _Bank, i: int, new: _Bank, child: int, moved: float) -> None:
    """The path of a stem that follows OP."""
    _copy(kept, i, new, child)
    new[0][child, _STEM] += moved


@kernel
def _rest(state: Array, op: float) -> None:
    """Stay at rest."""
    state[_HIGHEST], state[_LOWEST] = max(state[_HIGHEST], op), min(state[_LOWEST], op)


@kernel
def _slip(
    new: _Bank, child: int, way: float, op: float, frictions: Frictions, slides: bool
) -> float:
    """Slip upwards or downwards; where the stem stood before."""
    static, dynamic, static_deviation, dynamic_deviation, late_share = frictions
    mean, cov, state = new[0][child], new[1][child], new[2][child]
    # that it slips here tells where it stood
    _learn(mean, cov, op - way * static, static_deviation**2)
    stood: float = mean[_STEM]
    stands = op - way * dynamic
    state[_HIGHEST] = state[_LOWEST] = op
    state[_WAY] = way if slides else 0.0
    state[_LATENESS] = (late_share * (stands - stood)) ** 2
    mean[_STEM] = stands
    cov[_STEM, :] = 0.0
    cov[:, _STEM] = 0.0
    cov[_STEM, _STEM] = dynamic_deviation**2
    return stood


@kernel
def _chances(
    mean: Array, cov: Array, state: Array, step: tuple[float, float, float], frictions: Frictions
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Chances that a stem at rest stays, slips upwards and downwards, each with its way."""
    x, (_, op, quantum) = mean[_STEM], step
    static, deviation = frictions[0], math.sqrt(frictions[2] ** 2 + cov[_STEM, _STEM])
    up = _chance(state[_HIGHEST] - x - static, op - x - static, quantum, deviation)
    down = _chance(x - state[_LOWEST] - static, x - op - static, quantum, deviation)
    return (0.0, (1.0 - up) * (1.0 - down)), (1.0, up), (-1.0, down)


@kernel
def _linear_system(
    poles: tuple[float, float, float, float], gains: tuple[float, float], taps: Array, size: int
) -> tuple[Array, Array, Array]:
    """Rows that make up a state ``(3, 6)``, what the whitened PV shows of it ``(size,)``.

    And what a part of the stem that comes a sample late moves, ``(size,)``.
    """
    c1, c2, third, gain = poles
    forward = np.zeros((3, _SEEN))
    slow, out, seen = forward[0], forward[1], forward[2]
    slow[_STEM], slow[_FIRST], slow[_SLOW], slow[_SLOWER] = gain, -gain, c1, c2
    out[:] = (1.0 - third) * slow
    out[_OUT] += third
    seen[:] = gains[0] * out
    seen[_OUT] += gains[1]
    shown, late = np.zeros(size), np.zeros(size)
    shown[:_SEEN] = seen
    shown[_SEEN : _SEEN + taps.size] -= taps
    late[_SLOW], late[_OUT], late[_SEEN] = slow[_STEM], out[_STEM], seen[_STEM]
    return forward, shown, late


@kernel
def _chance(before: float, now: float, quantum: float, deviation: float) -> float:
    """Chance that a stem slips in a sample in which OP comes so far beyond its mean friction.

    It has not slipped until OP was ``before`` beyond it.
    """
    if now <= before - quantum:
        return 0.0
    low, high = min(before, now - quantum) / deviation, max(before, now) / deviation
    tail = 0.5 * math.erfc(low / math.sqrt(2.0))
    if tail > _NEVER:
        chance = 1.0 - 0.5 * math.erfc(high / math.sqrt(2.0)) / tail
    else:
        chance = 1.0 - math.exp(0.5 * (low * low - high * high))
    return min(max(chance, _SURPRISE), 1.0 - _SURPRISE)


@kernel
def _learn(mean: Array, cov: Array, stem: float, variance: float) -> None:
    """Take up that the stem stood at a place, known with a variance."""
    whole, off = cov[_STEM, _STEM] + variance, stem - mean[_STEM]
    if cov[_STEM, _STEM] <= 0.0 or abs(off) >= _FAR * math.sqrt(whole):
        return
    column = cov[:, _STEM].copy()
    for a in range(mean.size):
        mean[a] += column[a] / whole * off
        for b in range(mean.size):
            cov[a, b] -= column[a] * column[b] / whole


@kernel
def _moved(state: Array, forward: Array) -> None:
    """Put a state a sample on."""
    slow = out = seen = 0.0
    for i in range(_SEEN):
        slow += forward[0, i] * state[i]
        out += forward[1, i] * state[i]
        seen += forward[2, i] * state[i]
    for i in range(state.size - 1, _SEEN, -1):
        state[i] = state[i - 1]
    state[_SEEN], state[_OUT], state[_SLOWER], state[_SLOW] = seen, out, state[_SLOW], slow


@kernel
def _move_covariance(cov: Array, forward: Array, changed: Array) -> None:
    """Put a covariance ``(s, s)`` a sample on; ``changed`` ``(3, s)`` is room for its new rows."""
    size = cov.shape[0]
    changed[:] = 0.0
    for r in range(3):
        for i in range(_SEEN):
            for b in range(size):
                changed[r, b] += forward[r, i] * cov[i, b]
    # what only moves a place: the last rows first, because each takes the one before it
    for a in range(size - 1, _SEEN, -1):
        for b in range(size - 1, _SEEN, -1):
            cov[a, b] = cov[a - 1, b - 1]
        for place, before in ((_STEM, _STEM), (_FIRST, _FIRST), (_SLOWER, _SLOW)):
            cov[a, place] = cov[place, a] = cov[a - 1, before]
    cov[_SLOWER, _SLOWER] = cov[_SLOW, _SLOW]
    for place in (_STEM, _FIRST):
        cov[_SLOWER, place] = cov[place, _SLOWER] = cov[_SLOW, place]
    for r, at in enumerate((_SLOW, _OUT, _SEEN)):
        for b in range(size - 1, _SEEN, -1):
            cov[at, b] = cov[b, at] = changed[r, b - 1]
        for place, before in ((_STEM, _STEM), (_FIRST, _FIRST), (_SLOWER, _SLOW)):
            cov[at, place] = cov[place, at] = changed[r, before]
        for c, other in enumerate((_SLOW, _OUT, _SEEN)):
            if c > r:
                break
            total = 0.0
            for i in range(_SEEN):
                total += forward[c, i] * changed[r, i]
            cov[at, other] = cov[other, at] = total


@kernel
def _advance(
    mean: Array,
    cov: Array,
    forward: Array,
    shown: Array,
    late: Array,
    late_variance: float,
    seen: float,
    variance: float,
    room: Array,
) -> float:
    """Put a path a sample on and take up what PV shows; how likely that is, in nats.

    Nothing is taken up where ``seen`` is NaN. ``room`` ``(4, s)`` is asked for once: asking at
    every sample costs as much as this.
    """
    size = mean.size
    told = room[0]
    expected, whole = 0.0, variance
    for a in range(size):
        expected += shown[a] * mean[a]
        told[a] = 0.0
        for b in range(size):
            told[a] += cov[a, b] * shown[b]
        whole += shown[a] * told[a]
    _moved(told, forward)
    _moved(mean, forward)
    _move_covariance(cov, forward, room[1:])
    if late_variance > 0.0:
        whole += late_variance * late[_SEEN] ** 2
        for a in range(size):
            told[a] += late_variance * late[a] * late[_SEEN]
            for b in range(size):
                cov[a, b] += late_variance * (late[a] * late[b])
    if math.isnan(seen):
        return 0.0
    # rounding may not make it surer than the noise alone leaves it
    whole, off = max(whole, variance), seen - expected
    for a in range(size):
        mean[a] += told[a] / whole * off
        for b in range(size):
            cov[a, b] -= told[a] * told[b] / whole
    gained: float = -0.5 * (math.log(whole) + off * off / whole)
    return gained


@kernel
def _stem_of_path(
    u: Array, dead_time: int, last: float, event: int, events: Index, stood: Array
) -> Array:
    """The stem ``(n,)`` of a path, from its last event and where it stands at the end."""
    n = u.size
    stem = np.empty(n)
    end, at, anchor = n, last, u[n - 1 - dead_time]
    while event >= 0:
        begin = events[event, 1]
        for k in range(begin, end):
            stem[k] = at + u[k] - anchor if events[event, 2] else at
        at, end = stood[event], begin
        anchor = u[max(begin - 1, 0)]
        event = events[event, 0]
    return stem
