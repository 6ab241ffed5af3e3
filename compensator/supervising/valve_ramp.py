"""From the friction of the model in use to that of a newer one, a little each scan."""

from __future__ import annotations

from loop_model import ValveModel

__all__ = ["step_towards"]


def step_towards(have: ValveModel, goal: ValveModel, rate: float) -> ValveModel:
    """Return a valve whose frictions are nearer to those of another one.

    Args:
        have: the valve in use.
        goal: the valve to arrive at.
        rate: largest change of fS and of fD, in OP.
    """
    change_static = goal.static_friction - have.static_friction
    change_dynamic = goal.dynamic_friction - have.dynamic_friction
    if max(abs(change_static), abs(change_dynamic)) <= rate:
        return goal
    static = have.static_friction + min(max(change_static, -rate), rate)
    dynamic = have.dynamic_friction + min(max(change_dynamic, -rate), rate)
    # fD never passes fS on the way.
    return ValveModel.from_friction(static, min(dynamic, static))
