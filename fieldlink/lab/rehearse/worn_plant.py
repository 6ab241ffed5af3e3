"""A plant whose valve wears and is repaired, whose load varies and whose transmitter may fail."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fieldlink.lab.rehearse.errors import ScenarioError
from fieldlink.lab.rehearse.happenings import Repair
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.lab.rehearse.piecewise import value_at
from fieldlink.lab.rehearse.sensor import Transmitter
from fmu_models import Plant, PlantInfo

__all__ = ["WornPlant"]


class WornPlant:
    """What stands behind the PLC of a rehearsal.

    Args:
        plant: the FMU, started.
        scenario: what happens to it.
        op: OP at which it rests.

    Attributes:
        true_pv, measured_pv: PV now, and the transmitter's value.

    Raises:
        ScenarioError: the plant lacks a variable that the scenario needs.
    """

    def __init__(self, plant: Plant, scenario: Scenario, op: float) -> None:
        self._plant = plant
        self._scenario = scenario
        self._names = scenario.plant.variables
        self._transmitter = Transmitter(scenario.sensor, scenario.scenario.seed)
        self._in_front = scenario.valve is not None and scenario.valve.in_front
        self._stem = op
        try:
            self._require()
            self._outputs = self._measured(plant.outputs())
        except BaseException:
            plant.close()
            raise

    def _require(self) -> None:
        info, names, wanted = self._plant.info, self._names, []
        repaired = any(isinstance(event, Repair) for event in self._scenario.maintenance)
        if (repaired or self._scenario.valve is not None) and not self._in_front:
            wanted = [names.stick_band, names.slip_jump]
        if self._loaded:
            wanted.append(names.load)
        changeable = (*info.inputs, *info.tunable)
        for name in wanted:
            if name not in changeable:
                raise ScenarioError(
                    f"plant {info.name} has nothing that can be changed while it runs by the name "
                    f"{name!r}; it has {', '.join(changeable) or 'nothing'}: name it in "
                    "[plant.variables], remove [valve] or [load], or set valve.in_front = true for "
                    "an FMU without a valve"
                )

    @property
    def _loaded(self) -> bool:
        load = self._scenario.load
        return bool(load.sinusoids) or any(value for _, value in load.points)

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        return self._plant.info

    @property
    def time(self) -> float:
        """Plant seconds since the start."""
        return self._plant.time

    def valve(self, time: float) -> tuple[float, float]:
        """Return S and J at ``time``; NaN where the scenario leaves them to the FMU."""
        wear = self._scenario.valve
        repairs = [
            event
            for event in self._scenario.maintenance
            if isinstance(event, Repair) and event.at <= time
        ]
        if repairs:
            last = max(repairs, key=lambda event: event.at)
            return last.stick_band, last.slip_jump
        if wear is None:
            return math.nan, math.nan
        S = max(0.0, value_at(wear.stick_band, time))
        return S, min(S, max(0.0, value_at(wear.slip_jump, time)))

    def outputs(self) -> dict[str, float]:
        """Return the outputs at the present time; PV is the measured one."""
        return self._outputs

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs and what happens at this time, advance one period, return all outputs."""
        time = self.time
        given = dict(inputs)
        S, J = self.valve(time)
        if self._in_front:
            if self._names.op in given:
                given[self._names.op] = self._slip(given[self._names.op], S, J)
        elif math.isfinite(S):
            given |= {self._names.stick_band: S, self._names.slip_jump: J}
        if self._loaded:
            given[self._names.load] = self._load(time)
        self._outputs = self._measured(self._plant.step(given))
        return self._outputs

    def _slip(self, op: float, S: float, J: float) -> float:
        """Return the stem that He's valve gives for ``op``: where it was, or fD short of it."""
        distance = op - self._stem
        if abs(distance) > 0.5 * (S + J):
            self._stem = op - math.copysign(0.5 * (S - J), distance)
        return self._stem

    def close(self) -> None:
        """A PLC that goes away leaves the plant where it is; see `end`."""

    def end(self) -> None:
        """End the plant."""
        self._plant.close()

    def _measured(self, outputs: Mapping[str, float]) -> dict[str, float]:
        self.true_pv = outputs[self._names.pv]
        self.measured_pv = self._transmitter.measure(self.time, self.true_pv)
        seen = {**outputs, self._names.pv: self.measured_pv}
        return seen | {self._names.stem: self._stem} if self._in_front else seen

    def _load(self, time: float) -> float:
        load = self._scenario.load
        swings = sum(
            s.amplitude * math.sin(2.0 * math.pi * (time - s.begin) / s.period)
            for s in load.sinusoids
            if s.covers(time)
        )
        return value_at(load.points, time) + swings
