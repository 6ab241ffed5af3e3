"""Run an FMU: from its start or a saved state, accelerated or paced, driven or not.

Without a controller and without pacing, steps go in columns of some hundred; with either, one by
one. Time is ``start + k * step`` and deadlines are counted from the beginning, so neither drifts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.fmu.control import LoopController
from fieldlink.lab.fmu.errors import FmuError, nearest
from fieldlink.lab.fmu.inputs import InputSeries
from fieldlink.lab.fmu.mapping import FmuMap, InputMap, OutputMap
from fieldlink.lab.fmu.recorder import RunResult, RunTable
from fieldlink.lab.fmu.state_file import load_state, save_state
from fieldlink.lab.fmu.units import Conversion, conversion
from fmu_models import FmuSummary, Plant, PlantError, open_plant

__all__ = ["RunSettings", "run_fmu"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_ROWS = 500
_MOST_ROWS = 20_000_000
_DEFAULT_STEPS = 500
_SETPOINT = "SP"


@dataclass(frozen=True, slots=True)
class RunSettings:
    """How to run.

    Attributes:
        stop: second at which the run ends; None takes the default experiment's.
        step: seconds a step; None takes the map's, the default experiment's, or a 500th.
        start_values: by variable, in the FMU's units; they win over the map's parameters.
        inputs: recorded inputs, by tag or variable.
        watch: further variables to record.
        kind: "co-simulation" or "model exchange"; None takes the first that is offered.
        speed: plant seconds a second; None runs as fast as it can.
        isolated: run the FMU in a process of its own.
        timeout: seconds that the FMU may take to answer.
        load: a state file to begin from.
        save: a state file to write.
        save_at: the second at which it is written; None means the end.
    """

    stop: float | None = None
    step: float | None = None
    start_values: Mapping[str, float] = field(default_factory=dict)
    inputs: InputSeries | None = None
    watch: tuple[str, ...] = ()
    kind: str | None = None
    speed: float | None = None
    isolated: bool = True
    timeout: float = 60.0
    load: Path | None = None
    save: Path | None = None
    save_at: float | None = None


def run_fmu(
    fmu: FmuSummary,
    mapping: FmuMap,
    settings: RunSettings,
    progress: Progress | None = None,
) -> RunResult:
    """Run an FMU and return what it did.

    A failure of the FMU and an interruption (Ctrl-C) end it early and are in the result, with what
    was recorded until then.

    Args:
        fmu: what `fmu_models.summarise` says of it.
        mapping: from `load_map`; an empty one records inputs and outputs under their own names.
        settings: how to run.
        progress: called with the second that was reached.

    Raises:
        FmuError: map, inputs, times and FMU do not fit each other.
        PlantError: the FMU does not open.
    """
    return _Run(fmu, mapping, settings, progress or (lambda _: None)).result()


class _Run:
    def __init__(
        self, fmu: FmuSummary, mapping: FmuMap, settings: RunSettings, progress: Progress
    ) -> None:
        self.fmu, self.mapping, self.settings, self.progress = fmu, mapping, settings, progress
        numbers = {v.name: v for v in fmu.variables}
        own_inputs = [v.name for v in fmu.variables if _is_input(v.causality, v.type, v.scalar)]
        mapped = {entry.variable for entry in mapping.inputs.values()}
        self.inputs = dict(mapping.inputs) | {
            name: InputMap(variable=name) for name in own_inputs if name not in mapped
        }
        if mapping.outputs:
            self.outputs = dict(mapping.outputs)
        else:
            names = (v.name for v in fmu.variables if v.causality == "output" and v.scalar)
            self.outputs = {
                name: OutputMap(variable=name)
                for name in names
                if numbers[name].type not in ("String", "Binary", "Clock")
            }
        for name in settings.watch:
            self.outputs.setdefault(name, OutputMap(variable=name))
        self.conversions: dict[str, Conversion] = {}
        for tag, written in self.inputs.items():
            self.conversions[tag] = conversion(fmu, written.variable, written.unit)
        for tag, read in self.outputs.items():
            self.conversions[tag] = conversion(fmu, read.variable, read.unit)
        self.stop = _stop(fmu, settings.stop)
        wanted = mapping.period if settings.step is None else settings.step
        self.step = _default_step(fmu, self.stop) if wanted is None else wanted
        self.notes: list[str] = []
        self.late = 0
        if not self.outputs:
            raise FmuError(
                f"{fmu.file.name}: it has no outputs; name variables to record, "
                f"{nearest('', numbers)}"
            )

    def result(self) -> RunResult:
        begun = time.perf_counter()
        settings = self.settings
        with open_plant(
            self.fmu.file,
            parameters=self._start_values(),
            period=self.step,
            kind=settings.kind,
            watch=[out.variable for out in self.outputs.values()],
            isolated=settings.isolated,
            timeout=settings.timeout,
        ) as plant:
            if settings.load is not None:
                plant.restore(load_state(settings.load, self.fmu.file))
            if settings.save is not None and not plant.info.can_restore:
                raise FmuError(f"{self.fmu.file.name}: it offers no state that could be saved")
            return self._recorded(plant, begun)

    def _start_values(self) -> dict[str, float]:
        values = dict(self.mapping.parameters)
        for tag, entry in self.inputs.items():
            if entry.value is not None:
                values[entry.variable] = self.conversions[tag].to_variable(entry.value)
        values |= self.settings.start_values
        series = self.settings.inputs
        columns = set(series.columns) if series is not None else set()
        controlled = self.mapping.controller.op if self.mapping.controller else None
        undriven: list[str] = []
        for tag, entry in self.inputs.items():
            variable = self.fmu.variable(entry.variable)
            driven = tag in columns or tag == controlled or entry.variable in values
            if driven or variable is None or variable.causality != "input":
                continue
            if not variable.start:
                raise FmuError(
                    f"{self.fmu.file.name}: input {entry.variable} has no start value and nothing "
                    "drives it; give it one in the map, as a column of the inputs, or with --set "
                    f"{entry.variable}=VALUE"
                )
            undriven.append(tag)
        if undriven:
            self.notes.append(
                f"inputs that nothing drives keep their start values: {', '.join(undriven)}"
            )
        return values

    def _recorded(self, plant: Plant, begun: float) -> RunResult:
        start = plant.time
        count = math.ceil((self.stop - start) / self.step - 1e-9)
        if count < 1 or count > _MOST_ROWS:
            raise FmuError(
                f"from {start:g} s to {self.stop:g} s in steps of {self.step:g} s are {count} "
                f"steps; give a stop time and a step with 1 to {_MOST_ROWS} steps"
            )
        moments = start + np.arange(count, dtype=np.float64) * self.step
        driven = self._driven(moments)
        table = RunTable(plant.outputs(), count)
        save_row = self._save_row(start, count)
        failure: str | None = None
        one_by_one = self.mapping.controller is not None or self.settings.speed is not None
        try:
            if save_row == 0:
                self._save(plant)
            if one_by_one:
                self._stepwise(plant, moments, driven, table, save_row)
            else:
                self._columnwise(plant, count, driven, table, save_row)
        except PlantError as error:
            failure = str(error)
        except KeyboardInterrupt:
            failure = "it was interrupted"
        return self._pack(plant, moments, driven, table, failure, time.perf_counter() - begun)

    def _driven(self, moments: Array) -> dict[str, Array]:
        """Return the recorded inputs at every step, by tag and in the tag's unit."""
        series = self.settings.inputs
        values = {} if series is None else series.at(moments)
        controller = self.mapping.controller
        if controller is not None:
            if controller.op in values:
                raise FmuError(f"{controller.op} is written by the controller and by the inputs")
            values[_SETPOINT] = np.array([controller.at(float(t)) for t in moments])
        return values

    def _save_row(self, start: float, count: int) -> int | None:
        if self.settings.save is None:
            return None
        if self.settings.save_at is None:
            return count
        row = round((self.settings.save_at - start) / self.step)
        if not 0 <= row <= count:
            raise FmuError(
                f"the state cannot be saved at {self.settings.save_at:g} s: the run goes from "
                f"{start:g} s to {start + count * self.step:g} s"
            )
        return row

    def _save(self, plant: Plant) -> None:
        assert self.settings.save is not None
        save_state(self.settings.save, self.fmu.file, plant.snapshot())
        self.notes.append(f"state of {plant.time:g} s saved in {self.settings.save}")

    def _columnwise(
        self,
        plant: Plant,
        count: int,
        driven: Mapping[str, Array],
        table: RunTable,
        save_row: int | None,
    ) -> None:
        inputs = {
            self.inputs[tag].variable: self.conversions[tag].scale * values
            + self.conversions[tag].offset
            for tag, values in driven.items()
        }
        done = 0
        while done < count:
            rows = min(_ROWS, count - done)
            if save_row is not None and done < save_row:
                rows = min(rows, save_row - done)
            part = {name: values[done : done + rows] for name, values in inputs.items()}
            table.extend(plant.run(rows, part), rows)
            done += rows
            if done == save_row:
                self._save(plant)
            self.progress(plant.time)

    def _stepwise(
        self,
        plant: Plant,
        moments: Array,
        driven: dict[str, Array],
        table: RunTable,
        save_row: int | None,
    ) -> None:
        pi = self._controller(driven)
        begun = time.monotonic()
        for k in range(moments.size):
            inputs = {
                self.inputs[tag].variable: self.conversions[tag].to_variable(float(values[k]))
                for tag, values in driven.items()
                if tag in self.inputs and (pi is None or tag != pi.op_tag)
            }
            if pi is not None:
                pv = self.conversions[pi.pv_tag].to_tag(
                    table.last[self.outputs[pi.pv_tag].variable]
                )
                op = pi.decide(pv, float(driven[_SETPOINT][k]))
                driven[pi.op_tag][k:] = op
                change = self.conversions[pi.op_tag]
                inputs[self.inputs[pi.op_tag].variable] = change.to_variable(op)
            table.add(plant.step(inputs))
            if k + 1 == save_row:
                self._save(plant)
            if self.settings.speed is not None:
                due = begun + (k + 1) * self.step / self.settings.speed
                rest = due - time.monotonic()
                if rest > 0.0:
                    time.sleep(rest)
                elif -rest > self.step / self.settings.speed:
                    self.late += 1
            self.progress(plant.time)

    def _controller(self, driven: dict[str, Array]) -> LoopController | None:
        settings = self.mapping.controller
        if settings is None:
            return None
        variable = self.inputs[settings.op].variable
        start = self.settings.start_values.get(variable)
        op = self.inputs[settings.op].value
        if start is None and op is None:
            described = self.fmu.variable(variable)
            start = float(described.start) if described and described.start else None
        if start is not None:
            op = self.conversions[settings.op].to_tag(start)
        controller = LoopController(settings, self.step, settings.low if op is None else op)
        driven[settings.op] = np.full(driven[_SETPOINT].size, controller.op)
        return controller

    def _pack(
        self,
        plant: Plant,
        moments: Array,
        driven: Mapping[str, Array],
        table: RunTable,
        failure: str | None,
        seconds: float,
    ) -> RunResult:
        rows = table.rows
        columns: dict[str, Array] = {}
        for tag, values in driven.items():
            columns[tag] = np.append(values, values[-1])[:rows]
        for tag, out in self.outputs.items():
            columns[tag] = self._to_tag(tag, table.column(out.variable))
        units = {tag: self._unit(tag) for tag in columns}
        first = float(moments[0])
        return RunResult(
            model=plant.info.name,
            time=first + np.arange(rows, dtype=np.float64) * self.step,
            columns=columns,
            units=units,
            inputs=tuple(driven),
            notes=tuple(self.notes),
            failure=failure,
            late=self.late,
            seconds=seconds,
        )

    def _to_tag(self, tag: str, values: Array) -> Array:
        change = self.conversions[tag]
        return (values - change.offset) / change.scale

    def _unit(self, tag: str) -> str:
        if tag == _SETPOINT and self.mapping.controller is not None:
            tag = self.mapping.controller.pv
        entry = self.inputs.get(tag) or self.outputs.get(tag)
        if entry is None:
            return ""
        variable = self.fmu.variable(entry.variable)
        return entry.unit or (variable.unit if variable is not None else "")


def _is_input(causality: str, kind: str, scalar: bool) -> bool:
    return causality == "input" and scalar and kind not in ("String", "Binary", "Clock")


def _stop(fmu: FmuSummary, wanted: float | None) -> float:
    stop = fmu.stop_time if wanted is None else wanted
    if stop is None:
        raise FmuError(f"{fmu.file.name}: it names no stop time; give one with --stop SECONDS")
    if not math.isfinite(stop):
        raise FmuError(f"{fmu.file.name}: the stop time must be a finite second; got {stop}")
    return stop


def _default_step(fmu: FmuSummary, stop: float) -> float:
    """What the FMU recommends, or a round part of the experiment: some 500 steps."""
    if fmu.step_size:
        return fmu.step_size
    span = stop - fmu.start_time
    if not span > 0.0:
        raise FmuError(
            f"{fmu.file.name}: the stop time must lie after the start at {fmu.start_time:g} s"
        )
    raw = span / _DEFAULT_STEPS
    power = 10.0 ** math.floor(math.log10(raw))
    return min((factor * power for factor in (1.0, 2.0, 5.0, 10.0)), key=lambda h: abs(h - raw))
