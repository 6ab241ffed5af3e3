"""Open a plant by the name of the catalogue or by file, isolated or in this process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from .catalogue import plant_file
from .errors import PlantInputError
from .inprocess import InProcessPlant
from .isolated import IsolatedPlant
from .opening import OpenOptions
from .plant import Plant
from .ssp_structure import Master
from .start_values import StartValue
from .system_plant import SystemPlant

__all__ = ["open_plant"]

_NONE: Mapping[str, StartValue] = MappingProxyType({})


def open_plant(
    model: str | Path,
    *,
    parameters: Mapping[str, StartValue] = _NONE,
    period: float | None = None,
    kind: str | None = None,
    watch: Sequence[str] = (),
    isolated: bool = True,
    timeout: float = 30.0,
    master: Master | None = None,
    intermediate: bool = False,
) -> Plant:
    """Open a plant; it stands at its start, at rest.

    Args:
        model: a name of the catalogue, or the path of an FMU (FMI 1, 2 or 3) or of a system of
            FMUs (SSP 1.0). A string that ends in ``.fmu`` or ``.ssp`` is a path.
        parameters: start values of parameters and inputs, by variable name: a number, the text of
            a string variable, an item of an enumeration, "true" or "false".
        period: seconds that one step advances; None takes what the FMU recommends.
        kind: "co-simulation" or "model exchange"; None takes co-simulation where it is offered.
        watch: names of further variables to put out, such as ``der(tank.h)``.
        isolated: run it in a process of its own, so that a crash or an endless step of the FMU
            becomes a `PlantCrashError`. In this process steps are faster and crashes are fatal.
        timeout: seconds that an isolated plant may take to answer to one message; how many steps a
            message carries follows from how long they take.
        master: of a system, "gauss-seidel" (None takes it) or "jacobi"; see `SystemPlant`.
        intermediate: keep the outputs between the ends of a step, where a co-simulation FMU of
            FMI 3 offers them; `Plant.take_intermediate` returns them.

    Raises:
        PlantNameError: unknown model, parameter or input.
        PlantInputError: a value that cannot be set.
        PlantBuildError: the FMU of a catalogue model could not be built.
        PlantFileError: the file is not an FMU that runs here.
        PlantStepError: the FMU refused to start.
        PlantCrashError: it crashed while starting, or did not answer.
    """
    file = plant_file(model)
    if file.suffix == ".ssp":
        if intermediate:
            raise PlantInputError(f"{file}: a system keeps no outputs between the ends of a step")
        return SystemPlant(
            file,
            parameters=parameters,
            period=period,
            kind=kind,
            watch=watch,
            isolated=isolated,
            timeout=timeout,
            master=master,
        )
    if master is not None:
        raise PlantInputError(f"{file}: a master is for systems of FMUs (.ssp), this is one FMU")
    options = OpenOptions(parameters, period, kind, tuple(watch), intermediate)
    return IsolatedPlant(file, options, timeout) if isolated else InProcessPlant(file, options)
