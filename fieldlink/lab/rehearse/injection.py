"""Puts a defect of the scene into a scenario; those of the product have their own places."""

from __future__ import annotations

from fieldlink.lab.rehearse.defects import Defect
from fieldlink.lab.rehearse.happenings import Repair
from fieldlink.lab.rehearse.models import Scenario, ValveWear

__all__ = ["inject_into_scene"]

_VALVES = {
    Defect.STICKY_VALVE: ValveWear(stick_band=((0.0, 6.0),), slip_jump=((0.0, 2.0),)),
    Defect.HEALTHY_VALVE: ValveWear(stick_band=((0.0, 0.0),)),
}


def inject_into_scene(scenario: Scenario, defect: Defect) -> Scenario:
    """Return the scenario with the defect, where it is one of the scene."""
    if defect in _VALVES:
        return scenario.model_copy(
            update={"valve": _VALVES[defect], "maintenance": _without_repairs(scenario)}
        )
    if defect is Defect.NO_REPAIR:
        return scenario.model_copy(update={"maintenance": _without_repairs(scenario)})
    return scenario


def _without_repairs(scenario: Scenario) -> tuple[object, ...]:
    return tuple(event for event in scenario.maintenance if not isinstance(event, Repair))
