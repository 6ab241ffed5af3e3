"""``[loops.NAME.plant]``: what the simulated PLC hosts for a loop."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from fieldlink.site.device import Model, Seconds
from fieldlink.site.start_value import StartValue

__all__ = ["ControllerKind", "ExternalSettings", "PiSettings", "PlantSettings", "PlantVariables"]

ControllerKind = Literal["mpc", "pi", "none", "fmu", "external"]


class PiSettings(Model):
    """``[loops.NAME.plant.pi]``: the simulated PI controller."""

    gain: float
    """OP per PV."""
    integral_time: Seconds
    """Seconds."""


class ExternalSettings(Model):
    """``[loops.NAME.plant.external]``: a controller outside, which writes OP over Modbus."""

    timeout: Seconds = 10.0
    """Plant seconds without a write of OP after which the client counts as gone."""
    policy: Literal["hold", "fail_safe", "take_over"] = "hold"
    """What then has the loop: OP as it is, fail_safe_op, or the PLC's own PI."""
    fail_safe_op: float | None = None
    """OP of policy = "fail_safe"."""
    status: str | None = None
    """Tag that shows 0 client in command, 1 held, 2 fail-safe, 3 taken over, 4 manual."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.policy == "fail_safe") != (self.fail_safe_op is not None):
            raise ValueError(
                'policy = "fail_safe" and fail_safe_op belong together; add the value or remove it'
            )
        return self


class PlantVariables(Model):
    """``[loops.NAME.plant.variables]``: what the FMU calls the loop's signals."""

    op: str | None = None
    """Input that takes OP (with controller = "fmu": output that shows it); op unless given."""
    op_scale: float = Field(default=1.0, gt=0, le=1e6)
    """The FMU's input for 1 % of OP: 0.01 for an opening from 0 to 1."""
    pv: str | None = None
    """Output with PV; pv unless given."""
    stem: str | None = None
    """Output with the stem position, for judging; stem unless given, and it need not exist."""
    sp: str | None = None
    """Input that takes SP, for controller = "fmu"."""


class PlantSettings(Model):
    """``[loops.NAME.plant]``: what the simulated PLC hosts. Not used with a real PLC."""

    fmu: str | None = None
    """Name in the catalogue, or path of an .fmu file relative to the site file."""
    of: str | None = None
    """Loop whose FMU this loop is another part of, instead of an FMU of its own."""
    recording: Path | None = None
    """CSV with columns op and pv that is replayed instead of a plant, relative to the site file."""
    variables: PlantVariables = PlantVariables()
    """What the FMU calls the loop's signals."""
    controller: ControllerKind | None = None
    """Who decides OP; mpc for a plant and none for a recording unless given."""
    pi: PiSettings | None = None
    """Settings of controller = "pi", or of the PI that takes over from a controller outside."""
    external: ExternalSettings | None = None
    """Settings of controller = "external"."""
    compensate: bool = False
    """Whether the PLC accepts blocks and lets the compensator take over."""
    seed: int = Field(default=1, ge=0, le=0x7FFFFFFF)
    """Seed of the plant's noise."""
    setpoint: tuple[tuple[float, float], ...] = ()
    """Set-point steps: (plant seconds, value), in order of time."""
    parameters: Mapping[str, StartValue] = {}
    """Parameters of the FMU: numbers, words of booleans and enumerations, texts in quotes."""

    @property
    def controller_kind(self) -> ControllerKind:
        """The controller, with the default filled in."""
        return self.controller or ("none" if self.recording is not None else "mpc")

    @property
    def time_out(self) -> ExternalSettings:
        """The settings of a controller outside, with the defaults filled in."""
        return self.external or ExternalSettings()

    @model_validator(mode="after")
    def _complete(self) -> Self:
        given = [key for key in ("fmu", "of", "recording") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError(
                f"a plant is an fmu, a part of another loop's or a recording, here are "
                f"{' and '.join(given) or 'none'}; give exactly one of fmu, of and recording"
            )
        if self.recording is not None and (self.controller_kind != "none" or self.compensate):
            raise ValueError(
                "a recording cannot be controlled; remove controller and compensate, or give an fmu"
            )
        if self.of is not None and self.parameters:
            raise ValueError(
                f"parameters belong to the loop with the FMU; move them to [loops.{self.of}.plant]"
            )
        times = [time for time, _ in self.setpoint]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("setpoint: the times do not increase; sort the steps")
        return self

    @model_validator(mode="after")
    def _controlled(self) -> Self:
        kind = self.controller_kind
        if kind != "external" and self.external is not None:
            raise ValueError(
                f'the table external is for controller = "external", this is "{kind}"; remove it '
                "or change the controller"
            )
        takes_over = kind == "external" and self.time_out.policy == "take_over"
        if (kind == "pi" or takes_over) != (self.pi is not None):
            needs = 'policy = "take_over"' if takes_over else 'controller = "pi"'
            raise ValueError(
                f"{needs} and the table pi belong together; "
                "add pi = { gain = ..., integral_time = ... } or remove it"
            )
        if self.compensate and kind in ("external", "fmu"):
            raise ValueError(
                f'the compensator takes the loop over from a controller in the PLC, "{kind}" is '
                'none; remove compensate, or use controller = "pi"'
            )
        if self.variables.op_scale != 1.0 and kind == "fmu":
            raise ValueError(
                'variables.op_scale is for an OP that the PLC decides; with controller = "fmu" '
                "remove it"
            )
        if self.variables.sp is not None and kind != "fmu":
            raise ValueError(f'variables.sp is for controller = "fmu", this is "{kind}"; remove it')
        return self
