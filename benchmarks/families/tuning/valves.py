"""Valve laws, one step at a time: from controller output to stem position, both in percent.

All laws share two numbers. S (`stick_band`) is how far OP travels between the last stem movement in
one direction and the first in the other; J (`slip_jump`) is the size of the slip that follows.

- he: static friction fS = (S + J) / 2, dynamic friction fD = (S - J) / 2. The stem moves to
  OP -/+ fD as soon as OP is further than fS away, and rests again (He et al. 2007).
- kano: as he, but once moving the stem follows OP until OP stops or reverses between two scans
  (Kano et al. 2004).
- sliding: as kano, driven by the actuator's pressure, which follows OP with a lag
  (Choudhury et al. 2005).
- karnopp: mass, spring, viscous damping and Coulomb friction with a zone of zero velocity.
- lugre: the same stem on bristles (Canudas de Wit et al. 1995), with 1 / (1 + (v/vs)^2) as
  Stribeck curve.

Force balance of the two physical laws, all forces divided by the spring's stiffness and so in
percent of OP: x'' / w^2 = p - x - 2 zeta x' / w - F, p being the pressure. At rest after a move
upwards p - x = fD (damping is at least critical: no overshoot), so p must fall by fD + fS before
the stem moves down, and the slip ends at x = p + fD: a travel of fS - fD. Hence S = fS + fD and
J = fS - fD as above. Under lugre the bristles give way by (fS + fD) / sigma before that, so
S = (fS + fD)(1 + 1/sigma).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["LAWS", "move_stem", "valve_parameters", "valve_state"]

LAWS = ("none", "he", "kano", "sliding", "karnopp", "lugre")
"""A law's number in the kernels is its place here."""

DAMPING_RATIO = 1.15
"""Of the physical stem: 1.36 kg, 52.5 kN/m and 612 N s/m (Choudhury et al. 2005, Garcia 2008)."""

STEM_FREQUENCY = 15.0
"""Natural frequency in rad per scan: a slip is over within half a scan."""

BRISTLE_STIFFNESS = 60.0
"""Over the spring's: the stem creeps by 2 % of the friction before it breaks away."""

REST_VELOCITY = 0.02
"""Karnopp's zone of zero velocity and the sliding law's end of movement, in percent per scan."""

STRIBECK_VELOCITY = 0.1
"""Percent per scan: below the speed of OP in a cycle, or the stem would creep and never slip; above
the speed at which bristles give way before it, or the stem would break away below fS."""

FINE_STEPS = 240
"""Steps of the physical laws per scan: 0.5 rad of the bristles' own frequency."""


def valve_parameters(
    stick_band: float, slip_jump: float, pressure_lag: float
) -> NDArray[np.float64]:
    """fS, fD, J, S and the lag of the actuator's pressure in scans, as the kernels take them."""
    static, dynamic = (stick_band + slip_jump) / 2.0, (stick_band - slip_jump) / 2.0
    return np.array([static, dynamic, slip_jump, stick_band, pressure_lag])


def valve_state(op: float, dynamic_friction: float) -> NDArray[np.float64]:
    """At rest after a move upwards: position, direction, moving, OP at rest, pressure, v, z."""
    return np.array([op - dynamic_friction, 1.0, 0.0, op, op, 0.0, 0.0])


@njit(cache=True)
def _move_he(state, op, par):  # type: ignore[no-untyped-def]
    distance = op - state[0]
    if distance > par[0]:
        state[0] = op - par[1]
    elif distance < -par[0]:
        state[0] = op + par[1]


@njit(cache=True)
def _follow(state, before, now, par, rest):  # type: ignore[no-untyped-def]
    """Kano's rule for a drive that went from `before` to `now`."""
    if state[2] > 0.0 and (now - before) * state[1] <= rest:
        state[2] = 0.0
        state[3] = before
    if state[2] == 0.0:
        travelled = state[1] * (now - state[3])
        if travelled > par[2]:
            state[2] = 1.0
        elif -travelled > par[3]:
            state[1] = -state[1]
            state[2] = 1.0
    if state[2] > 0.0:
        state[0] = now - state[1] * par[1]


@njit(cache=True)
def _move_karnopp(state, pressure, par, step):  # type: ignore[no-untyped-def]
    w = STEM_FREQUENCY
    force = pressure - state[0]
    if state[5] == 0.0:
        if abs(force) <= par[0]:
            return
        direction = 1.0 if force > 0.0 else -1.0
    else:
        direction = 1.0 if state[5] > 0.0 else -1.0
    v = (state[5] + step * w * w * (force - direction * par[1])) / (
        1 + 2 * DAMPING_RATIO * w * step
    )
    if v * direction <= REST_VELOCITY:
        # Breaking away with J near 0 starts slower than the zone's edge, and still starts.
        v = direction * REST_VELOCITY * 1.0001 if abs(force) > par[0] else 0.0
    state[5] = v
    state[0] += step * v


@njit(cache=True)
def _move_lugre(state, pressure, par, step):  # type: ignore[no-untyped-def]
    w = STEM_FREQUENCY
    soft = 1.0 + 1.0 / BRISTLE_STIFFNESS
    static, dynamic = (par[3] / soft + par[2]) / 2.0, (par[3] / soft - par[2]) / 2.0
    if dynamic < 0.0:
        dynamic = 0.0
    x, v, z = state[0], state[5], state[6]
    stribeck = v / STRIBECK_VELOCITY
    level = max(dynamic + (static - dynamic) / (1.0 + stribeck * stribeck), 1e-3)
    # Implicit in z and in the viscous force: stable however fast the slip.
    next_z = (z + step * v) / (1.0 + step * BRISTLE_STIFFNESS * abs(v) / level)
    bristle_damping = 2.0 * np.sqrt(BRISTLE_STIFFNESS) / w
    friction = BRISTLE_STIFFNESS * next_z
    gain = step * w * w
    state[5] = (v + gain * (pressure - x - friction)) / (
        1.0 + gain * (2.0 * DAMPING_RATIO / w + bristle_damping / (1.0 + stribeck * stribeck))
    )
    state[6] = next_z
    state[0] = x + step * state[5]


@njit(cache=True)
def move_stem(law, state, op, par, inner):  # type: ignore[no-untyped-def]
    """Advance the stem by 1 / `inner` of a scan in which the controller output is `op`."""
    if law == 0:
        state[0] = op
    elif law == 1:
        _move_he(state, op, par)
    elif law == 2:
        # OP changes once per scan; in between it is held, which is not a stop.
        if op != state[4]:
            _follow(state, state[4], op, par, 0.0)
            state[4] = op
    elif law == 3:
        before = state[4]
        state[4] += (op - before) * (1.0 - np.exp(-1.0 / (inner * par[4])))
        _follow(state, before, state[4], par, REST_VELOCITY / inner)
    else:
        fine = max(1, FINE_STEPS // inner)
        step = 1.0 / (inner * fine)
        share = 1.0 - np.exp(-step / par[4])
        for _ in range(fine):
            state[4] += (op - state[4]) * share
            if law == 4:
                _move_karnopp(state, state[4], par, step)
            else:
                _move_lugre(state, state[4], par, step)
    if state[0] < 0.0:
        state[0] = 0.0
    elif state[0] > 100.0:
        state[0] = 100.0
