"""Valves of the report family: three data-driven laws and two of friction forces.

A law moves the stem by one step of time. Its numbers are a `Valve`, its memory an array of
`STATES` values: stem, last OP, run or stuck, direction, anchor, speed, bristle, air pressure.
Positions, pressures and forces are all in units of OP (a force divided by the spring's stiffness).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled import kernel

__all__ = ["HEALTHY", "LAWS", "STATES", "Valve", "measure_by_ramp", "move_stem", "start_stem"]

Array = NDArray[np.float64]

LAWS = {"none": 0, "he": 1, "kano": 2, "sliding": 3, "karnopp": 4, "lugre": 5}
"""Codes of the laws in the compiled code."""

STATES = 8
"""Values in a valve's memory."""

DWELL = 0.02
"""A sliding stem stops when OP retreats by this share of S; less is noise. Own choice."""


class Valve(NamedTuple):
    """A valve's law and its numbers, in units of OP and seconds (or samples, see the caller)."""

    law: int
    static: float
    """Static friction fS = (S + J) / 2."""
    dynamic: float
    """Friction while moving, fD = (S - J) / 2."""
    air_lag: float = 0.0
    """Time constant of the actuator's air."""
    viscous: float = 0.0
    """Viscous friction over spring stiffness, time; Karnopp and LuGre only."""
    inertia: float = 0.0
    """Mass over spring stiffness, time squared; Karnopp and LuGre only."""
    stribeck: float = 1.0
    """Speed at which static friction has fallen to dynamic friction, OP per time."""
    stiffness: float = 1.0
    """Stiffness of LuGre's bristles over that of the spring."""


HEALTHY = Valve(0, 0.0, 0.0)


@kernel
def start_stem(state: Array, u: float) -> None:
    """Put a valve's memory at rest at ``u``."""
    state[:] = 0.0
    state[0] = u
    state[1] = u
    state[3] = 1.0
    state[4] = u
    state[7] = u


@kernel
def _he(valve: Valve, state: Array, u: float) -> None:
    """He et al. (2007): jump whenever the spring's force exceeds static friction, else stay."""
    error = u - state[0]
    if abs(error) > valve.static:
        state[0] = u - math.copysign(valve.dynamic, error)


@kernel
def _kano(valve: Valve, state: Array, u: float) -> None:
    """Kano et al. (2004): stuck since OP's last turn, or moving along with OP."""
    band, jump = valve.static + valve.dynamic, valve.static - valve.dynamic
    step = u - state[1]
    if step == 0.0:
        return
    if state[2] > 0.0 and step * state[3] <= 0.0:
        state[2] = 0.0
        state[4] = state[1]
    if state[2] > 0.0:
        state[0] = u - state[3] * valve.dynamic
        return
    along = (u - state[4]) * state[3]
    if along < -band or (along > jump and along > 0.0):
        if along < 0.0:
            state[3] = -state[3]
        state[2] = 1.0
        state[0] = u - state[3] * valve.dynamic


@kernel
def _sliding(valve: Valve, state: Array, u: float) -> None:
    """Choudhury et al. (2005): stick, jump, then slide with OP until OP turns.

    The turn is read with a dead zone, so that noise in OP does not stop the stem, and the stem
    stays where the envelope of OP left it: a stem that slides does not follow OP's noise back.
    """
    band, jump = valve.static + valve.dynamic, valve.static - valve.dynamic
    along = (u - state[4]) * state[3]
    if state[2] > 0.0:
        if along > 0.0:
            state[4] = u
            state[0] = u - state[3] * valve.dynamic
        elif along < -DWELL * band - 1e-12:
            state[2] = 0.0
        return
    if along < -band:
        state[3] = -state[3]
    elif along <= jump:
        return
    state[2] = 1.0
    state[4] = u
    state[0] = u - state[3] * valve.dynamic


@kernel
def _karnopp(valve: Valve, state: Array, u: float, dt: float) -> None:
    """Karnopp (1985): a force balance with a zone of speeds in which the stem counts as at rest.

    Speed and position are implicit in the step, so that a stiff light stem stays stable.
    """
    x, speed = state[0], state[5]
    net = u - x
    if speed == 0.0:
        if abs(net) <= valve.static:
            return
        direction = math.copysign(1.0, net)
    else:
        direction = math.copysign(1.0, speed)
    friction = valve.dynamic + (valve.static - valve.dynamic) * math.exp(
        -((speed / valve.stribeck) ** 2)
    )
    if speed == 0.0:
        friction = valve.dynamic
    mass = valve.inertia + dt * valve.viscous + dt * dt
    faster = (valve.inertia * speed + dt * (net - direction * friction)) / mass
    if faster * direction <= 1e-3 * valve.stribeck:
        faster = 0.0
    state[5] = faster
    state[0] = x + dt * faster


@kernel
def _lugre(valve: Valve, state: Array, u: float, dt: float) -> None:
    """LuGre (Canudas de Wit et al., 1995): bristles that bend before they slip, implicit in dt."""
    x, speed, z = state[0], state[5], state[6]
    limit = valve.dynamic + (valve.static - valve.dynamic) * math.exp(
        -((speed / valve.stribeck) ** 2)
    )
    limit = max(limit, 1e-9) / valve.stiffness
    fade = 1.0 / (1.0 + dt * abs(speed) / limit)
    spring = valve.stiffness * fade
    mass = valve.inertia + dt * valve.viscous + dt * dt * (1.0 + spring)
    faster = (valve.inertia * speed + dt * (u - x - spring * z)) / mass
    z = (z + dt * faster) / (1.0 + dt * abs(faster) / limit)
    state[5] = faster
    state[6] = z
    state[0] = x + dt * faster


@kernel
def move_stem(valve: Valve, state: Array, u: float, dt: float) -> float:
    """Move the stem for one step ``dt`` under OP ``u``; the stem's position after it."""
    if valve.air_lag > 0.0:
        state[7] += (u - state[7]) * (1.0 - math.exp(-dt / valve.air_lag))
        u = state[7]
    if valve.law == 0:
        state[0] = u
    elif valve.law == 1:
        _he(valve, state, u)
    elif valve.law == 2:
        _kano(valve, state, u)
    elif valve.law == 3:
        _sliding(valve, state, u)
    elif valve.law == 4:
        _karnopp(valve, state, u, dt)
    else:
        _lugre(valve, state, u, dt)
    state[1] = u
    return float(state[0])


@kernel
def _ramp_test(valve: Valve, span: float, rate: float, dt: float) -> tuple[float, float]:
    state = np.zeros(STATES)
    start_stem(state, 0.0)
    u, direction, slip_from, left_at, moving = 0.0, 1.0, 0.0, 0.0, False
    bands, jumps = np.zeros(3), np.zeros(64)
    n_jumps = turns = 0
    last_direction = 1.0
    while turns < 4:
        u += direction * rate * dt
        before = state[0]
        x = move_stem(valve, state, u, dt)
        speed = abs(x - before) / dt
        if not moving and speed > 3.0 * rate:
            moving, slip_from = True, before
            if last_direction != direction:
                bands[turns - 1] = abs(u - left_at)
                last_direction = direction
        elif moving and speed < 1.5 * rate:
            moving = False
            if turns >= 1 and n_jumps < jumps.size:
                jumps[n_jumps] = abs(x - slip_from)
                n_jumps += 1
        if speed > 0.5 * rate and last_direction == direction:
            left_at = u
        if u * direction >= span:
            direction = -direction
            turns += 1
    jump = np.median(jumps[:n_jumps]) if n_jumps > 0 else 0.0
    return float(np.median(bands)), float(jump)


def measure_by_ramp(valve: Valve, dt: float) -> tuple[float, float]:
    """Stick band S and slip jump J that a slow ramp of OP up and down finds.

    For the laws of forces this is the truth: Stribeck speed, viscosity, bristles and the length
    ``dt`` of a step shift both from what the two frictions alone would give. The ramp is slow
    beside a slip and beside the Stribeck speed, so that the stem sticks again after every slip;
    a valve that glides on it gives 0 for both.
    """
    band = valve.static + valve.dynamic
    slow = band / max(120.0 * dt, 30.0 * (valve.viscous + math.sqrt(valve.inertia)))
    rate = min(slow, 0.2 * valve.stribeck) if valve.law >= LAWS["karnopp"] else slow
    return _ramp_test(valve._replace(air_lag=0.0), 3.3 * band, rate, dt)
