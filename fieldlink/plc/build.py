"""From a loop of the site file to the program that the simulated PLC runs for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from compensator import (
    CompensatorError,
    Controller,
    HybridSettings,
    MpcSettings,
    OpLimits,
    PiController,
    PiSettings,
    Supervisor,
    SupervisorSettings,
    UnawareMpc,
)
from fieldlink.errors import FieldlinkError
from fieldlink.plc.control import ControlledLoop
from fieldlink.plc.program import LoopProgram, ReplayedLoop
from fieldlink.site import Loop, PlantSettings, Site, read_recording
from fmu_models import CatalogueModel, Plant, PlantError, catalogue, open_plant
from loop_model import ProcessModel

__all__ = ["LoopSetup", "PlcError", "build_program"]

INPUT, OUTPUT = "op", "pv"
ANSWER_WITHIN = 10.0
"""Seconds that an FMU may take: the PLC stands still meanwhile, once, before it goes on without."""


class PlcError(FieldlinkError):
    """The site file asks for a simulated PLC that cannot be built."""


def build_program(site: Site, name: str, *, isolated: bool = True) -> LoopProgram:
    """Start what the site file puts behind a loop.

    Args:
        site: the site.
        name: a loop with a plant.
        isolated: run an FMU in a process of its own, so that its crash is not the PLC's.

    Raises:
        PlcError: the FMU, the controller and the loop do not fit each other.
        RecordingError: the recording cannot be read.
    """
    loop = site.loops[name]
    plant = loop.plant
    if plant is None:
        raise PlcError(f"loop {name} has no plant; add a table [loops.{name}.plant]")
    if plant.recording is not None:
        return ReplayedLoop(read_recording(site.resolve(plant.recording), period=loop.period))
    setup = LoopSetup.of(site, name)
    started = setup.open(isolated=isolated)
    try:
        return setup.control(started)
    except BaseException:
        started.close()
        raise


@dataclass(frozen=True, slots=True)
class LoopSetup:
    """What the site file says of a loop with an FMU, looked up but not started.

    Attributes:
        name: of the loop.
        loop, settings: its tables.
        model: what `fmu_models.open_plant` takes.
        known: the plant's entry in the catalogue; None for a file.
        limits: range of OP.
        op: OP at which the plant begins.
    """

    name: str
    loop: Loop
    settings: PlantSettings
    model: str | Path
    known: CatalogueModel | None
    limits: OpLimits
    op: float

    @classmethod
    def of(cls, site: Site, name: str) -> LoopSetup:
        """Look a loop up that has a plant with an FMU."""
        loop = site.loops[name]
        settings = loop.plant
        assert settings is not None
        assert settings.fmu is not None
        known = catalogue.get(settings.fmu)
        model: str | Path = settings.fmu if known is not None else site.resolve(settings.fmu)
        limits = OpLimits(*known.op_range) if known is not None else OpLimits()
        return cls(name, loop, settings, model, known, limits, _first_op(settings, limits))

    def open(self, *, isolated: bool = True) -> Plant:
        """Start the plant.

        Raises:
            PlcError: it cannot be started, or has no output pv.
        """
        try:
            plant = open_plant(
                self.model,
                parameters=_parameters(self.settings, self.known) | {INPUT: self.op},
                period=self.loop.period,
                isolated=isolated,
                timeout=ANSWER_WITHIN,
            )
        except PlantError as error:
            raise PlcError(f"loop {self.name}: {error}") from error
        if OUTPUT not in plant.info.outputs:
            plant.close()
            raise PlcError(
                f"loop {self.name}: {self.settings.fmu} has no output {OUTPUT!r}, it has "
                f"{', '.join(plant.info.outputs) or 'none'}; a plant needs the input op and "
                "output pv"
            )
        return plant

    def control(
        self,
        plant: Plant,
        supervision: SupervisorSettings | None = None,
        op: float | None = None,
    ) -> ControlledLoop:
        """Put the loop's controller before a plant whose OP is ``op``, at its start unless given.

        Raises:
            PlcError: the controller does not fit the plant.
        """
        process = _process(self.known, self.loop.period)
        try:
            controller = _controller(self.name, self.loop, self.settings, process, self.limits)
        except CompensatorError as error:
            raise PlcError(f"loop {self.name}: {error}") from error
        supervision = supervision or SupervisorSettings(hybrid=HybridSettings(limits=self.limits))
        supervisor = None if controller is None else Supervisor(controller, supervision)
        return ControlledLoop(
            self.name, plant, supervisor, self.op if op is None else op, self.limits
        )


def _parameters(settings: PlantSettings, known: CatalogueModel | None) -> dict[str, float]:
    """The site's parameters; a plant of the catalogue takes its seed from the site as well."""
    seed = {"seed": float(settings.seed)} if known is not None else {}
    return seed | dict(settings.parameters)


def _process(known: CatalogueModel | None, period: float) -> ProcessModel | None:
    """The linear model that a plant of the catalogue has at the loop's period."""
    if known is None or known.process is None or known.process.period != period:
        return None
    return known.process


def _first_op(settings: PlantSettings, limits: OpLimits) -> float:
    """OP at which the plant begins at rest, as the site says or 40 % up its range.

    Not the middle, where so many set-points are: a stem that happens to rest just where it should
    shows no stiction for as long as nothing disturbs it.
    """
    given = settings.parameters.get(INPUT, settings.parameters.get("op_start"))
    return limits.low + 0.4 * (limits.high - limits.low) if given is None else float(given)


def _controller(
    name: str,
    loop: Loop,
    settings: PlantSettings,
    process: ProcessModel | None,
    limits: OpLimits,
) -> Controller | None:
    if settings.controller_kind == "none":
        return None
    if settings.controller_kind == "pi":
        assert settings.pi is not None
        return PiController(
            PiSettings(settings.pi.gain, settings.pi.integral_time, loop.period, limits)
        )
    if process is None:
        usable = ", ".join(
            f"{m.name} ({m.period:g} s)" for m in catalogue.values() if m.process is not None
        )
        raise PlcError(
            f'loop {name}: controller = "mpc" needs a plant with a linear model at the loop\'s '
            f"period of {loop.period:g} s, {settings.fmu} has none; choose one of {usable}, or "
            'controller = "pi"'
        )
    return UnawareMpc(process, MpcSettings(limits=limits))
