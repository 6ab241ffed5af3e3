"""Puts a defect of the scene into a scenario; those of the product have their own places."""

from __future__ import annotations

from fieldlink.lab.rehearse.expected import END
from fieldlink.lab.rehearse.happenings import Misestimate, NetworkFault, Repair
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.lab.rehearse.models import Scenario, ValveWear

__all__ = ["inject_into_scene"]

_VALVES = {
    Defect.STICKY_VALVE: ValveWear(stick_band=((0.0, 6.0),), slip_jump=((0.0, 2.0),)),
    Defect.HEALTHY_VALVE: ValveWear(stick_band=((0.0, 0.0),)),
}
_WRITES = {
    Defect.DAMAGED_BLOCKS: NetworkFault(kind="write_flipped", begin=0.0, end=END),
    Defect.TORN_BLOCKS: NetworkFault(kind="write_torn", begin=0.0, end=END),
}
_WRONG_SIGN = Misestimate(begin=0.0, end=END, gain_factor=-1.0)


def inject_into_scene(scenario: Scenario, defect: Defect) -> Scenario:
    """Return the scenario with the defect, where it is one of the scene."""
    if defect in _VALVES:
        in_front = scenario.valve is not None and scenario.valve.in_front
        valve = _VALVES[defect].model_copy(update={"in_front": in_front})
        return scenario.model_copy(
            update={"valve": valve, "maintenance": _without_repairs(scenario)}
        )
    if defect in _WRITES:
        return scenario.model_copy(update={"network": (*scenario.network, _WRITES[defect])})
    if defect is Defect.WRONG_SIGN:
        return scenario.model_copy(update={"misestimate": (*scenario.misestimate, _WRONG_SIGN)})
    if defect is Defect.NO_REPAIR:
        return scenario.model_copy(update={"maintenance": _without_repairs(scenario)})
    return scenario


def _without_repairs(scenario: Scenario) -> tuple[object, ...]:
    return tuple(event for event in scenario.maintenance if not isinstance(event, Repair))
