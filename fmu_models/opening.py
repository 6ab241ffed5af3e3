"""Read, extract and load an FMU, up to the moment before its start values go in."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .archive import MODEL_EXCHANGE, extract_fmu, read_description
from .clocks import read_input_clocks
from .errors import PlantError, PlantInputError
from .instances import CoSimulation, Instance
from .intermediate import IntermediateLog
from .library import load
from .model_exchange import ModelExchange
from .plant import PlantInfo
from .start_values import StartValue, StartValues, list_texts, sort_start_values
from .variables import VariableAccess

__all__ = ["DescribedFmu", "LoadedFmu", "OpenOptions", "describe_fmu", "load_fmu"]


@dataclass(frozen=True, slots=True)
class OpenOptions:
    """How one FMU is opened.

    Attributes:
        parameters: start values by name: numbers, texts of string variables, words for numbers.
        period: seconds a step; None takes the FMU's default experiment.
        kind: "co-simulation" or "model exchange"; None takes the first that it offers.
        watch: names of further variables that come back with the outputs.
        intermediate: keep the outputs between the ends of a step, for `Plant.take_intermediate`.
    """

    parameters: Mapping[str, StartValue] = field(default_factory=dict)
    period: float | None = None
    kind: str | None = None
    watch: Sequence[str] = ()
    intermediate: bool = False


@dataclass(frozen=True, slots=True)
class DescribedFmu:
    """An FMU by its archive alone, for one set of options.

    Attributes:
        description: FMPy's model description.
        info: what it is.
        variables: for reading and writing.
        starts: the start values that were asked for.
    """

    description: Any
    info: PlantInfo
    variables: VariableAccess
    starts: StartValues


@dataclass(frozen=True, slots=True)
class LoadedFmu:
    """An FMU that is loaded and instantiated.

    Attributes:
        info: what it is.
        instance: for stepping.
        variables: for reading and writing.
        start_time: of its default experiment, seconds.
        starts: the start values that were asked for.
        folder: a temporary folder with its contents; None where the caller gave one.
        intermediate: outputs between the ends of a step; None where they are not asked for.
    """

    info: PlantInfo
    instance: Instance
    variables: VariableAccess
    start_time: float
    starts: StartValues
    folder: tempfile.TemporaryDirectory[str] | None
    intermediate: IntermediateLog | None


def describe_fmu(file: Path, options: OpenOptions) -> DescribedFmu:
    """Read what an FMU is, without running anything of it.

    Raises:
        PlantFileError: it cannot be read, or does not run here in that kind.
        PlantNameError: a watched variable does not exist.
        PlantInputError: a start value or a period that it cannot take.
    """
    description, kind = read_description(file, options.kind)
    exchange = kind == MODEL_EXCHANGE
    interface = description.modelExchange if exchange else description.coSimulation
    starts = sort_start_values(description, options.parameters)
    variables = VariableAccess(description, options.watch, starts.structural)
    roles = variables.roles
    info = PlantInfo(
        name=description.modelName,
        fmi_version=description.fmiVersion,
        kind=kind,
        period=_period(description, options.period, file),
        inputs=roles.inputs,
        tunable=roles.tunable,
        outputs=(*roles.outputs, *variables.watched),
        parameters=(*roles.parameters, *variables.structural, *list_texts(description)),
        can_restore=bool(interface.canGetAndSetFMUstate and interface.canSerializeFMUstate),
        can_vary_step=exchange or bool(interface.canHandleVariableCommunicationStepSize),
    )
    return DescribedFmu(description, info, variables, starts)


def load_fmu(file: Path, options: OpenOptions, folder: Path | None) -> LoadedFmu:
    """Read, extract and load an FMU.

    Args:
        file: the ``.fmu``.
        options: how to open it.
        folder: where to extract; None makes a temporary folder, which is in the answer.

    Raises:
        PlantError: what `open_plant` says.
    """
    described = describe_fmu(file, options)
    description, info, variables = described.description, described.info, described.variables
    version, exchange = int(description.fmiVersion[0]), info.kind == MODEL_EXCHANGE
    interface = description.modelExchange if exchange else description.coSimulation
    offered = version == 3 and not exchange and bool(interface.providesIntermediateUpdate)
    if options.intermediate and not offered:
        raise PlantInputError(
            f"{file}: it offers no outputs between the ends of a step (that takes co-simulation of "
            "FMI 3 with providesIntermediateUpdate); take shorter steps instead"
        )
    log = IntermediateLog(variables, info.outputs) if options.intermediate else None
    clocks = read_input_clocks(file) if version == 3 else ()
    own: tempfile.TemporaryDirectory[str] | None = None
    if folder is None:
        own = tempfile.TemporaryDirectory(prefix="fieldlink-fmu-", ignore_cleanup_errors=True)
        folder = Path(own.name)
    try:
        extract_fmu(file, folder)
        listener = None if log is None else (log.listen, variables.output_references)
        fmu = load(description, info.kind, folder, listener)
    except BaseException:
        if own is not None:
            own.cleanup()
        raise
    if log is not None:
        log.fmu = fmu
    instance: Instance
    if exchange:
        instance = ModelExchange(fmu, version, description, info.period, clocks)
    else:
        event_mode = version == 3 and bool(interface.hasEventMode)
        instance = CoSimulation(
            fmu,
            version,
            event_mode=event_mode,
            clocks=clocks,
            can_vary_step=info.can_vary_step,
        )
    start = _start_time(description)
    return LoadedFmu(info, instance, variables, start, described.starts, own, log)


def _start_time(description: Any) -> float:
    experiment = description.defaultExperiment
    return float(experiment.startTime) if experiment and experiment.startTime else 0.0


def _period(description: Any, wanted: float | None, file: Path) -> float:
    experiment = description.defaultExperiment
    if wanted is None and experiment and experiment.stepSize:
        wanted = float(experiment.stepSize)
    if wanted is None:
        raise PlantError(f"{file}: the FMU names no step size; give the period in seconds")
    if not 0.0 < wanted < float("inf"):
        raise PlantInputError(
            f"{file}: the period must be a positive number of seconds, not {wanted:g}"
        )
    return wanted
