"""The site file, key by key, as typed and frozen models.

What one table shows is checked here; what needs two tables or another file is checked
in `fieldlink.site.rules`. Paths are as written; `fieldlink.site.Site` resolves them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from fieldlink.registers import ExchangeLayout
from fieldlink.site.compensate import CompensateSettings
from fieldlink.site.daemon_tables import (
    EstimationSettings,
    HistorianTable,
    ReportSettings,
    WebSettings,
)
from fieldlink.site.device import Address, Device, Model, Seconds
from fieldlink.site.findings import FindingsTable
from fieldlink.site.mqtt import MqttSettings
from fieldlink.site.notify import NotifySettings
from fieldlink.site.opcua_server import OpcuaServerSettings
from fieldlink.site.plant import ExternalSettings, PiSettings, PlantSettings, PlantVariables

__all__ = [
    "Device",
    "EstimationSettings",
    "EstimatorSettings",
    "ExchangeAddresses",
    "ExternalSettings",
    "HistorianTable",
    "Loop",
    "PiSettings",
    "PlantSettings",
    "PlantVariables",
    "ReportSettings",
    "SiteFile",
    "SiteSettings",
    "WebSettings",
    "WriteBack",
    "WriteLimits",
]

Span = tuple[float, float]

LARGEST_LIMIT = 1e6
"""Units of OP: a single float of a parameter block still resolves a tenth of a unit there."""


class SiteSettings(Model):
    """``[site]``: the site as a whole."""

    name: str = Field(min_length=1)
    """Name of the site, for people."""
    data_dir: Path = Path("data")
    """Folder for what Fieldlink writes, relative to the site file."""


class EstimatorSettings(Model):
    """``[loops.NAME.estimator]``: how the loop's windows are judged."""

    criterion: Literal["auto", "oe", "arx"] = "auto"
    """Fit criterion: auto allows coloured noise, oe white noise only, arx looks one step ahead."""
    confidence: float = Field(default=0.9, gt=0.5, lt=1)
    """Confidence of the intervals."""


class ExchangeAddresses(Model):
    """``[loops.NAME.writeback.addresses]``: each exchange register (holding, 0-based)."""

    enable: Address
    """PLC: bit 0 allows blocks to be written and used."""
    ack_seq: Address
    """PLC: sequence number of the block last accepted."""
    ack_result: Address
    """PLC: outcome of the block last committed."""
    active_bank: Address
    """PLC: bank of the block last accepted."""
    ack_commit: Address
    """PLC: the commit word that ack_result is about."""
    heartbeat: Address
    """Fieldlink: counts while it lives."""
    commit: Address
    """Fieldlink: bank and low byte of the sequence number."""
    bank_a: Address
    """Fieldlink: first register of bank A."""
    bank_b: Address
    """Fieldlink: first register of bank B."""
    ack_refusal: Address | None = None
    """PLC: why the consumer refuses or gave up the model; left out, refusals are not reported."""
    writer: Address | None = None
    """Fieldlink: identity of the installation that writes; may be left out."""


class WriteLimits(Model):
    """``[loops.NAME.writeback.limits]``: ranges (units of OP) outside which nothing is written."""

    stick_band: Span = (0.0, 20.0)
    """Lowest and highest stick band S."""
    slip_jump: Span = (0.0, 20.0)
    """Lowest and highest slip jump J."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for name in ("stick_band", "slip_jump"):
            low, high = getattr(self, name)
            if not 0 <= low < high:
                raise ValueError(
                    f"{name} = [{low:g}, {high:g}] must be 0 <= low < high; reorder it"
                )
            if high > LARGEST_LIMIT:
                raise ValueError(
                    f"{name} = [{low:g}, {high:g}] reaches beyond {LARGEST_LIMIT:g} units of OP; "
                    "correct it"
                )
        return self


class WriteBack(Model):
    """``[loops.NAME.writeback]``: how the valve model reaches the PLC. Off by default."""

    enabled: bool = False
    """Whether Fieldlink may write blocks (the PLC's enable register must allow it too)."""
    loop_id: int | None = Field(default=None, ge=1, le=0xFFFF)
    """Number of the loop inside the block; needed with an exchange area."""
    base: Address | None = None
    """First register of the exchange area in its compact layout."""
    addresses: ExchangeAddresses | None = None
    """The exchange registers one by one, instead of base."""
    limits: WriteLimits = WriteLimits()
    """Ranges outside which nothing is written."""
    deadband: float = Field(default=0.05, ge=0, le=1e6)
    """Least change of S or J (units of OP) that is worth a new block."""
    min_interval: float = Field(default=60.0, ge=0, le=1e8)
    """Least plant seconds between two blocks."""
    valid_for: int = Field(default=86400, ge=1, le=0xFFFFFFFF)
    """Plant seconds after which the PLC stops using a block."""
    min_windows: int = Field(default=2, ge=1, le=0xFFFF)
    """Windows that must agree before a block is written."""
    max_age: float | None = Field(default=None, gt=0)
    """Plant seconds from the end of its window for which a finding may wait to be written; four
    estimate periods unless given."""

    @property
    def exchange(self) -> ExchangeLayout | None:
        """The exchange area, None when the loop has none."""
        if self.base is not None:
            return ExchangeLayout.at(self.base)
        if self.addresses is not None:
            return ExchangeLayout(**self.addresses.model_dump())
        return None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.base is not None and self.addresses is not None:
            raise ValueError("base and addresses are both given; keep one of them")
        area = self.base is not None or self.addresses is not None
        if self.enabled and not area:
            raise ValueError("enabled = true needs an exchange area; give base or addresses")
        if area and self.loop_id is None:
            raise ValueError("an exchange area needs a loop_id; give a number from 1 to 65535")
        try:
            _ = self.exchange
        except ValueError as error:
            raise ValueError(f"{error}; move the exchange area") from error
        return self


class Loop(Model):
    """``[loops.NAME]``: one control loop."""

    device: str
    """Name of the device that has the loop's tags."""
    area: str = Field(default="plant", min_length=1)
    """Part of the plant that the loop belongs to, for topics and reports."""
    op: str
    """Tag of the controller output."""
    pv: str
    """Tag of the process variable."""
    sp: str | None = None
    """Tag of the set-point."""
    mode: str | None = None
    """Tag of the controller's mode."""
    auto_values: tuple[float, ...] = Field(default=(1.0,), min_length=1)
    """Values of the mode tag that mean automatic."""
    scan: str | None = None
    """Tag of the controller's cycle counter; samples are placed by it."""
    period: Seconds
    """Plant seconds between samples."""
    window: int = Field(default=800, ge=50, le=1_000_000)
    """Samples that are judged together."""
    estimate_every: Seconds | None = None
    """Plant seconds between estimates; half a window unless given."""
    estimator: EstimatorSettings = EstimatorSettings()
    """How windows are judged."""
    writeback: WriteBack = WriteBack()
    """How the valve model reaches the PLC."""
    compensate: CompensateSettings = CompensateSettings()
    """The compensator beside the PLC."""
    plant: PlantSettings | None = None
    """What the simulated PLC hosts for this loop."""

    @property
    def estimate_period(self) -> float:
        """Plant seconds between estimates, with the default filled in."""
        return self.estimate_every or 0.5 * self.window * self.period

    @property
    def tags(self) -> tuple[str, ...]:
        """The loop's tags: OP and PV first, then what is given of SP, mode and scan."""
        optional = (self.sp, self.mode, self.scan)
        return (self.op, self.pv, *(name for name in optional if name is not None))


class SiteFile(Model):
    """A whole site file."""

    site: SiteSettings
    """The site as a whole."""
    devices: Mapping[str, Device] = Field(min_length=1)
    """Devices by name."""
    loops: Mapping[str, Loop] = Field(min_length=1)
    """Control loops by name."""
    historian: HistorianTable = HistorianTable()
    """Where history is stored."""
    estimation: EstimationSettings = EstimationSettings()
    """The processes in which windows are judged."""
    web: WebSettings = WebSettings()
    """Health, metrics and the operators' pages over HTTP."""
    report: ReportSettings = ReportSettings()
    """The work list and its schedule."""
    mqtt: MqttSettings | None = None
    """Publishing to an MQTT broker."""
    findings: FindingsTable = FindingsTable()
    """Why loops swing, diagnosed again and again by the daemon."""
    notify: NotifySettings | None = None
    """Notices of findings and lost devices, over HTTP and by e-mail."""
    opcua_server: OpcuaServerSettings | None = None
    """A read-only OPC UA server of loops and devices."""
