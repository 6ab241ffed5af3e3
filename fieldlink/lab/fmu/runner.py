"""Run an FMU: from its start or a saved state, accelerated or paced, driven or not.

Without a controller and without pacing, steps go in columns of some hundred; with either, one by
one. Time is ``start + k * step`` and deadlines are counted from the beginning, so neither drifts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.lab.fmu.experiment import Steps, choose_step, choose_stop, divide
from fieldlink.lab.fmu.mapping import FmuMap
from fieldlink.lab.fmu.recorder import TIME_VARIABLE, RunResult, RunTable
from fieldlink.lab.fmu.row_writer import RowWriter
from fieldlink.lab.fmu.run_settings import RunSettings
from fieldlink.lab.fmu.signals import SETPOINT, Signals
from fieldlink.lab.fmu.state_file import load_state, save_state
from fmu_models import (
    FmuSummary,
    Plant,
    PlantEndedError,
    PlantError,
    StartValue,
    open_plant,
)

if TYPE_CHECKING:
    from fieldlink.lab.fmu.control import LoopController

__all__ = ["run_fmu"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]


def run_fmu(
    fmu: FmuSummary,
    mapping: FmuMap,
    settings: RunSettings,
    progress: Progress | None = None,
) -> RunResult:
    """Run an FMU and return what it did.

    An FMU that ends the simulation, a failure of it and an interruption (Ctrl-C) are in the result,
    with what was recorded until then.

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
        given = {**mapping.parameters, **settings.start_values}
        sizes = {name: value for name, value in given.items() if not isinstance(value, str)}
        self.signals = Signals(fmu, mapping, sizes, settings.watch)
        self.stop = choose_stop(fmu, settings.stop)
        wanted = mapping.period if settings.step is None else settings.step
        self.step, note = choose_step(fmu, self.stop, wanted)
        self.notes = [] if note is None else [note]
        if "time" in self.signals.outputs or "time" in self.signals.inputs:
            self.notes.append(f"the variable called time is the column {TIME_VARIABLE}")
        self.given: dict[str, StartValue] = {}
        self.late = 0
        self.ended: str | None = None
        self.failure: str | None = None

    def result(self) -> RunResult:
        begun = time.perf_counter()
        settings = self.settings
        self.given = self._start_values()
        with open_plant(
            self.fmu.file,
            parameters=self.given,
            period=self.step,
            kind=settings.kind,
            watch=[out.variable for out in self.signals.outputs.values()],
            isolated=settings.isolated,
            timeout=settings.timeout,
            master=settings.master,
            intermediate=settings.intermediate is not None,
        ) as plant:
            if settings.load is not None:
                plant.restore(load_state(settings.load, self.fmu.file))
            if settings.save is not None and not plant.info.can_restore:
                raise FmuError(f"{self.fmu.file.name}: it offers no state that could be saved")
            result = self._recorded(plant)
        return replace(result, seconds=time.perf_counter() - begun)

    def _start_values(self) -> dict[str, StartValue]:
        """Values before the start; an input that is recorded begins with its first row."""
        signals, series = self.signals, self.settings.inputs
        values: dict[str, StartValue] = dict(self.mapping.parameters)
        for tag, entry in signals.inputs.items():
            if entry.value is not None:
                values[entry.variable] = signals.conversions[tag].to_variable(entry.value)
        if series is not None:
            first = series.at(np.array([self.fmu.start_time]))
            values |= {n: float(v[0]) for n, v in signals.to_variables(first).items()}
        values |= self.settings.start_values
        driven = set(series.columns) if series is not None else set()
        if self.mapping.controller is not None:
            driven.add(self.mapping.controller.op)
        undriven = signals.undriven(driven, values)
        if undriven:
            self.notes.append(
                f"inputs that nothing drives keep their start values: {', '.join(undriven)}"
            )
        return values

    def _recorded(self, plant: Plant) -> RunResult:
        start = plant.time
        variable = plant.info.can_vary_step
        steps = divide(start, self.stop, self.step, variable=variable)
        moments = start + np.arange(steps.count, dtype=np.float64) * self.step
        if not variable and self.stop - moments[-1] - self.step > 1e-9 * self.step:
            self.notes.append(
                f"it takes steps of {self.step:g} s only, so the run ends at "
                f"{moments[-1] + self.step:g} s"
            )
        driven = self._driven(moments)
        self._note_unused_inputs(start)
        self._note_outside(driven)
        table = RunTable(start, plant.outputs(), steps.count)
        rows = RowWriter(self.settings, self.signals, driven, table)
        save_row = self._save_row(start, steps.count)
        one_by_one = self.mapping.controller is not None or self.settings.speed is not None
        try:
            if save_row == 0:
                self._save(plant)
            if one_by_one:
                self._stepwise(plant, moments, driven, table, rows, steps, save_row)
            else:
                self._columnwise(plant, driven, table, rows, steps, save_row)
        except PlantEndedError as error:
            self.ended = str(error)
        except PlantError as error:
            self.failure = str(error)
        except KeyboardInterrupt:
            self.failure = "it was interrupted"
        return self._pack(plant.info.name, driven, table, rows)

    def _note_outside(self, driven: Mapping[str, Array]) -> None:
        """Name values outside of their ranges: most of them are in another unit."""
        starts = {n: np.array([v]) for n, v in self.given.items() if not isinstance(v, str)}
        controller = self.mapping.controller
        # What the controller will write is not known yet.
        own = controller.op if controller is not None else None
        given = {tag: values for tag, values in driven.items() if tag != own}
        outside = self.signals.list_outside(starts | self.signals.to_variables(given))
        if outside:
            self.notes.append(
                f"outside of the range that the FMU names: {', '.join(outside)}; is the unit right?"
            )

    def _note_unused_inputs(self, start: float) -> None:
        """Say where the recorded inputs begin after the run or go on behind it."""
        series = self.settings.inputs
        if series is None or not series.time.size:
            return
        first, last = float(series.time[0]), float(series.time[-1])
        if first >= self.stop or last >= self.stop + self.step:
            self.notes.append(
                f"the inputs go from {first:g} s to {last:g} s and the run from {start:g} s to "
                f"{self.stop:g} s: rows after its end are not used (is their time in seconds?)"
            )

    def _driven(self, moments: Array) -> dict[str, Array]:
        """Return the recorded inputs at every step, by tag and in the tag's unit."""
        series = self.settings.inputs
        values = {} if series is None else series.at(moments)
        controller = self.mapping.controller
        if controller is not None:
            if controller.op in values:
                raise FmuError(f"{controller.op} is written by the controller and by the inputs")
            values[SETPOINT] = np.array([controller.at(float(t)) for t in moments])
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
        driven: Mapping[str, Array],
        table: RunTable,
        rows: RowWriter,
        steps: Steps,
        save_row: int | None,
    ) -> None:
        inputs = self.signals.to_variables(driven)
        ends = sorted({steps.count, min(save_row or steps.count, steps.count)})
        done = 0
        for end in ends:
            part = {name: values[done:end] for name, values in inputs.items()}
            last = steps.last if end == steps.count else None
            for piece in plant.run_pieces(end - done, part, last=last):
                table.extend(piece)
                rows.write_some()
                self.progress(float(piece.time[-1]))
            rows.write_intermediate(plant)
            done = end
            if done == save_row:
                self._save(plant)

    def _stepwise(
        self,
        plant: Plant,
        moments: Array,
        driven: dict[str, Array],
        table: RunTable,
        rows: RowWriter,
        steps: Steps,
        save_row: int | None,
    ) -> None:
        signals = self.signals
        pi = self._controller(driven)
        begun = time.monotonic()
        for k in range(moments.size):
            inputs = {
                signals.inputs[tag].variable: signals.conversions[tag].to_variable(float(values[k]))
                for tag, values in driven.items()
                if tag in signals.inputs and (pi is None or tag != pi.op_tag)
            }
            if pi is not None:
                read = table.last[signals.outputs[pi.pv_tag].variable]
                op = pi.decide(
                    signals.conversions[pi.pv_tag].to_tag(read), float(driven[SETPOINT][k])
                )
                driven[pi.op_tag][k:] = op
                change = signals.conversions[pi.op_tag]
                inputs[signals.inputs[pi.op_tag].variable] = change.to_variable(op)
            last = steps.last if k == steps.count - 1 else None
            for piece in plant.run_pieces(1, inputs, last=last):
                table.extend(piece)
            rows.write_some()
            rows.write_intermediate(plant)
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
        # Here, because its compiled loops take seconds to load, and few runs have a controller.
        from fieldlink.lab.fmu.control import LoopController

        change = self.signals.conversions[settings.op]
        variable = self.signals.inputs[settings.op].variable
        start = self.settings.start_values.get(variable)
        op = self.signals.inputs[settings.op].value
        if start is None and op is None:
            described = self.fmu.variable(variable)
            start = float(described.start) if described and described.start else None
        if isinstance(start, float):
            op = change.to_tag(start)
        controller = LoopController(settings, self.step, settings.low if op is None else op)
        driven[settings.op] = np.full(driven[SETPOINT].size, controller.op)
        return controller

    def _pack(
        self, model: str, driven: Mapping[str, Array], table: RunTable, rows: RowWriter
    ) -> RunResult:
        rows.write_all()
        columns = rows.columns(0, table.rows)
        rounded = self.signals.list_rounded(columns)
        if rounded:
            self.notes.append(f"whole numbers beyond 2^53 are rounded: {', '.join(rounded)}")
        return RunResult(
            model=model,
            time=table.time[: table.rows],
            columns=columns,
            units={tag: self.signals.unit(tag) for tag in columns},
            inputs=tuple(driven),
            notes=tuple(self.notes),
            ended=self.ended,
            failure=self.failure,
            late=self.late,
            seconds=0.0,
            start_values=self.given,
            step=self.step,
        )
