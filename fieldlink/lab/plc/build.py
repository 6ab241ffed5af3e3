"""From the loops of the site file to the programs that the simulated PLC runs for them."""

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
from fieldlink.lab.plc.control import ControlledLoop, SelfControlledLoop, Signals
from fieldlink.lab.plc.op_sources import ByClient, ByHand, OpSource, Supervised, TimeOut
from fieldlink.lab.plc.plants import HostedPlant
from fieldlink.lab.plc.program import LoopProgram, ReplayedLoop
from fieldlink.lab.plc.scaled_plant import ScaledPlant
from fieldlink.site import Loop, PlantSettings, Site, read_recording
from fieldlink.site.missing_rows import fill_missing_rows
from fmu_models import (
    CatalogueModel,
    LoopVariables,
    Plant,
    PlantError,
    PlantInfo,
    StartValue,
    catalogue,
    open_plant,
)
from loop_model import ProcessModel

__all__ = ["LoopSetup", "PlcError", "Programs"]

ANSWER_WITHIN = 60.0
"""Seconds that an FMU may take to start or for a step before it is given up: starting its process
takes ten and more on a loaded machine."""


class PlcError(FieldlinkError):
    """The site file asks for a simulated PLC that cannot be built."""


class Programs:
    """Starts what the site file puts behind its loops; loops of one FMU share it.

    Args:
        site: the site.
        isolated: run every FMU in a process of its own, so that its crash is not the PLC's.
    """

    def __init__(self, site: Site, *, isolated: bool = True) -> None:
        self._site = site
        self._isolated = isolated
        self._plants: dict[str, HostedPlant] = {}

    def build(self, name: str) -> LoopProgram:
        """Return the program of a loop.

        Raises:
            PlcError: the FMU, the controller and the loop do not fit each other.
            RecordingError: the recording cannot be read.
        """
        loop = self._site.loops[name]
        if loop.plant is None:
            raise PlcError(f"loop {name} has no plant; add a table [loops.{name}.plant]")
        if loop.plant.recording is not None:
            recording = self._site.resolve(loop.plant.recording)
            return ReplayedLoop(fill_missing_rows(read_recording(recording, period=loop.period)))
        setup = LoopSetup.of(self._site, name)
        if setup.owner not in self._plants:
            self._plants[setup.owner] = HostedPlant(setup.open(isolated=self._isolated))
        return setup.program(self._plants[setup.owner])

    def close(self) -> None:
        """End every plant that was started."""
        for plant in self._plants.values():
            plant.close()


@dataclass(frozen=True, slots=True)
class LoopSetup:
    """What the site file says of a loop with an FMU, looked up but not started.

    Attributes:
        site: the site.
        name: of the loop.
        loop, settings: its tables.
        owner: the loop that has the FMU; this one, unless it is another part of that.
        model: what `fmu_models.open_plant` takes.
        known: the plant's entry in the catalogue; None for a file.
        signals: what the loop's signals are called in the FMU.
        limits: range of OP.
        op: OP at which the plant begins.
    """

    site: Site
    name: str
    loop: Loop
    settings: PlantSettings
    owner: str
    model: str | Path
    known: CatalogueModel | None
    signals: Signals
    limits: OpLimits
    op: float

    @classmethod
    def of(cls, site: Site, name: str) -> LoopSetup:
        """Look a loop up that has a plant with an FMU, or a part of one."""
        loop = site.loops[name]
        settings = loop.plant
        assert settings is not None
        owner = settings.of or name
        owning = site.loops[owner].plant
        assert owning is not None
        assert owning.fmu is not None
        known = catalogue.get(owning.fmu)
        model: str | Path = owning.fmu  # a name that the catalogue lacks is its to complain about
        if owning.fmu.endswith((".fmu", ".ssp")):
            model = site.resolve(owning.fmu)
        signals = _signals(settings, known, _sharing(site, owner).index(name))
        limits = OpLimits(*known.op_range) if known is not None else OpLimits()
        op = _first_op(owning, signals.op, limits)
        return cls(site, name, loop, settings, owner, model, known, signals, limits, op)

    def sharing(self) -> list[LoopSetup]:
        """Return the setups of all loops of the FMU, that of its owner first."""
        return [LoopSetup.of(self.site, name) for name in _sharing(self.site, self.owner)]

    def start_values(self) -> dict[str, StartValue]:
        """Return what the FMU is opened with: the site's parameters, and what follows from it."""
        settings = self.site.loops[self.owner].plant
        assert settings is not None
        return _parameters(settings, self.known, self.sharing())

    def open(self, *, isolated: bool = True) -> Plant:
        """Start the FMU for every loop that it has.

        Raises:
            PlcError: it cannot be started, or lacks a variable of one of them.
        """
        setups = self.sharing()
        try:
            plant = open_plant(
                self.model,
                parameters=self.start_values(),
                period=self.loop.period,
                isolated=isolated,
                timeout=ANSWER_WITHIN,
            )
        except PlantError as error:
            raise PlcError(f"loop {self.name}: {error}") from error
        try:
            for setup in setups:
                for missing in setup.missing_variables(plant.info).values():
                    raise PlcError(f"loop {setup.name}: {missing}")
        except BaseException:
            plant.close()
            raise
        scales = {
            setup.signals.op: scale
            for setup in setups
            if (scale := setup.settings.variables.op_scale) != 1.0
        }
        return ScaledPlant(plant, scales) if scales else plant

    def program(self, plant: HostedPlant) -> LoopProgram:
        """Return the loop's program on a plant that rests at ``op``.

        Raises:
            PlcError: the controller does not fit the plant.
        """
        if self.settings.controller_kind == "fmu":
            return SelfControlledLoop(self.name, plant, self.signals)
        return self.control(plant)

    def control(
        self,
        plant: HostedPlant,
        op: float | None = None,
        supervise: type[Supervisor] = Supervisor,
    ) -> ControlledLoop:
        """Put the loop's controller before a plant whose OP is ``op``, at its start unless given.

        ``supervise`` makes who switches between controller and compensator.

        Raises:
            PlcError: the controller does not fit the plant.
        """
        source = self.op_source(supervise)
        return ControlledLoop(self.name, plant, self.signals, source, self.op if op is None else op)

    def op_source(self, supervise: type[Supervisor] = Supervisor) -> OpSource:
        """Return who decides OP of a loop whose controller is not in the FMU.

        Raises:
            PlcError: the controller does not fit the plant.
        """
        try:
            return self._source(supervise)
        except CompensatorError as error:
            raise PlcError(f"loop {self.name}: {error}") from error

    def _source(self, supervise: type[Supervisor]) -> OpSource:
        kind, period, limits = self.settings.controller_kind, self.loop.period, self.limits
        if kind == "none":
            return ByHand(limits)
        if kind == "external":
            asked = self.settings.time_out
            safe = limits.low if asked.fail_safe_op is None else asked.fail_safe_op
            own = self._pi() if asked.policy == "take_over" else None
            return ByClient(TimeOut(asked.timeout, asked.policy, safe), period, limits, own)
        controller = self._pi() if kind == "pi" else self._mpc()
        settings = SupervisorSettings(
            hybrid=HybridSettings(limits=limits), gain_sign=self._gain_sign(), period=period
        )
        return Supervised(supervise(controller, settings), limits)

    def _gain_sign(self) -> int:
        """The sign of the process gain that the loop's own controller counts on; 0: unknown."""
        process = _process(self.known, self.loop.period)
        tuning = self.settings.pi
        counted = tuning.gain if tuning is not None else 0.0
        if tuning is None and process is not None:
            counted = sum(process.b)
        return (counted > 0.0) - (counted < 0.0)

    def _pi(self) -> Controller:
        tuning = self.settings.pi
        assert tuning is not None
        return PiController(
            PiSettings(tuning.gain, tuning.integral_time, self.loop.period, self.limits)
        )

    def _mpc(self) -> Controller:
        process = _process(self.known, self.loop.period)
        if process is None:
            usable = ", ".join(
                f"{m.name} ({m.period:g} s)" for m in catalogue.values() if m.process is not None
            )
            raise PlcError(
                f'loop {self.name}: controller = "mpc" needs a plant with a linear model at the '
                f"loop's period of {self.loop.period:g} s, {self.model} has none; choose one of "
                f'{usable}, or controller = "pi"'
            )
        return UnawareMpc(process, MpcSettings(limits=self.limits))

    def missing_variables(self, info: PlantInfo) -> dict[str, str]:
        """Return what a plant lacks of the loop's signals: a sentence for each, by role."""
        op_kind = "output" if self.settings.controller_kind == "fmu" else "input"
        wanted = {"pv": (self.signals.pv, "output"), "op": (self.signals.op, op_kind)}
        if self.signals.sp is not None:
            wanted["sp"] = (self.signals.sp, "input")
        known = {"output": info.outputs, "input": info.inputs}
        return {
            role: f"{self.model} has no {kind} {name!r} for {role}, it has "
            f"{', '.join(known[kind]) or 'none'}; name it in its plant.variables"
            for role, (name, kind) in wanted.items()
            if name not in known[kind]
        }


def _sharing(site: Site, owner: str) -> list[str]:
    """Return the loops of one FMU, the one that has it first, the others as in the site file."""
    parts = [
        name
        for name, loop in site.loops.items()
        if loop.plant is not None and loop.plant.of == owner
    ]
    return [owner, *parts]


def _signals(settings: PlantSettings, known: CatalogueModel | None, number: int) -> Signals:
    """What the loop's signals are called: as the site says, else as in the catalogue.

    The loops of one plant of the catalogue take its loops in order.
    """
    given, inside = settings.variables, settings.controller_kind == "fmu"
    loops = known.loops if known is not None else (LoopVariables(),)
    usual = loops[min(number, len(loops) - 1)]
    sp = given.sp or (usual.sp if inside and known is not None else None)
    op = given.op or (usual.op_out if inside else usual.op)
    return Signals(op, given.pv or usual.pv, given.stem or usual.stem, sp)


def _parameters(
    settings: PlantSettings, known: CatalogueModel | None, setups: list[LoopSetup]
) -> dict[str, StartValue]:
    """The site's parameters, and what follows from the rest of it.

    A plant of the catalogue takes its seed from the site, and has a controller inside that can be
    switched on and tuned.
    """
    found: dict[str, StartValue] = {}
    if known is not None:
        found["seed"] = float(settings.seed)
    for number, setup in enumerate(setups):
        if setup.settings.controller_kind != "fmu":
            found[setup.signals.op] = setup.op * setup.settings.variables.op_scale
        elif known is not None:
            found[known.loops[min(number, len(known.loops) - 1)].controller] = 1.0
    return found | dict(settings.parameters)


def _process(known: CatalogueModel | None, period: float) -> ProcessModel | None:
    """The linear model that a plant of the catalogue has at the loop's period."""
    if known is None or known.process is None or known.process.period != period:
        return None
    return known.process


def _first_op(settings: PlantSettings, name: str, limits: OpLimits) -> float:
    """OP at which the plant begins at rest, as the site says or 40 % up its range.

    Not the middle, where so many set-points are: a stem that happens to rest just where it should
    shows no stiction for as long as nothing disturbs it.
    """
    given = settings.parameters.get(name, settings.parameters.get(f"{name}_start"))
    if given is None or isinstance(given, str):  # a text is refused where the FMU is opened
        return limits.low + 0.4 * (limits.high - limits.low)
    return given / settings.variables.op_scale if name in settings.parameters else given
