"""The parameter block: an identified loop as a PLC reads it.

`ParameterBlock` is checked when it is built, so every block can be sent, and every decoded
block can be used. `fieldlink.registers.block_words` turns it into registers and back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fieldlink.registers.block_layout import MAX_COEFFICIENTS
from fieldlink.registers.codes import BlockError, BlockFault, Status, Verdict
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = [
    "Bounded",
    "ParameterBlock",
    "block_gain",
    "is_newer",
    "next_seq",
]

_FLOAT32_MAX = 3.4e38
_SEQ_LAST = 0xFFFF


@dataclass(frozen=True, slots=True)
class Bounded:
    """An estimate with the bounds of its interval, ``low <= value <= high``."""

    value: float
    low: float
    high: float

    @classmethod
    def exact(cls, value: float) -> Bounded:
        """Return an estimate whose bounds are the value itself."""
        return cls(value, value, value)


_ZERO = Bounded(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ParameterBlock:
    """All that one block says. Friction values are in units of OP.

    Attributes:
        loop_id: 1 to 65535, as in the site file.
        seq: 1 to 65535.
        status: what is asked of the reader; `Status.INVALID` cannot be sent.
        valid_for: whole seconds from acceptance to expiry, at least 1.
        window_end_ms: end of the window, UTC milliseconds since 1970.
        static_friction, dynamic_friction, stick_band, slip_jump: fS, fD, S, J with bounds.
        confidence: of the bounds, between 0 and 1.
        smoothing: tau of the smoothed model, 0 when not used.
        process: up to four a and four b; None when the block carries no process model.
        verdict, windows, samples, fit, evidence: the estimate's quality.

    Raises:
        BlockError: with `BlockFault.OUT_OF_RANGE`, `SEQ_ZERO` or `STATUS`.
    """

    loop_id: int
    seq: int
    status: Status
    valid_for: int
    window_end_ms: int = 0
    static_friction: Bounded = _ZERO
    dynamic_friction: Bounded = _ZERO
    stick_band: Bounded = _ZERO
    slip_jump: Bounded = _ZERO
    confidence: float = 0.9
    smoothing: float = 0.0
    process: ProcessModel | None = None
    verdict: Verdict = Verdict.NONE
    windows: int = 0
    samples: int = 0
    fit: float = 0.0
    evidence: float = 0.0

    def __post_init__(self) -> None:
        if self.seq == 0:
            raise BlockError(BlockFault.SEQ_ZERO)
        if self.status is Status.INVALID:
            raise BlockError(BlockFault.STATUS, "status 0")
        for name, value, most in (
            ("loop_id", self.loop_id, 0xFFFF),
            ("seq", self.seq, _SEQ_LAST),
            ("valid_for", self.valid_for, 0xFFFFFFFF),
        ):
            _require(1 <= value <= most, f"{name} = {value}, limit 1 to {most}")
        _require(0 <= self.windows <= 0xFFFF, f"windows = {self.windows}")
        _require(0 <= self.samples <= 0xFFFFFFFF, f"samples = {self.samples}")
        _require(0 <= self.window_end_ms < 2**64, f"window_end_ms = {self.window_end_ms}")
        _require(0.0 < self.confidence < 1.0, f"confidence = {self.confidence}")
        for name in ("smoothing", "fit", "evidence"):
            _require_float32(name, getattr(self, name))
        _require(self.smoothing >= 0.0, f"smoothing = {self.smoothing}")
        self._check_valve()
        if self.process is not None:
            _check_process(self.process)

    @classmethod
    def from_model(
        cls,
        model: LoopModel,
        *,
        loop_id: int,
        seq: int,
        valid_for: int,
        window_end_ms: int,
        static_friction: Bounded | None = None,
        dynamic_friction: Bounded | None = None,
        stick_band: Bounded | None = None,
        slip_jump: Bounded | None = None,
        confidence: float = 0.9,
        smoothing: float = 0.0,
        windows: int = 1,
        samples: int = 0,
        fit: float = 0.0,
        evidence: float = 0.0,
    ) -> ParameterBlock:
        """Return a `Status.VALID` block for ``model``; bounds that are not given are the value."""
        valve = model.valve
        return cls(
            loop_id=loop_id,
            seq=seq,
            status=Status.VALID,
            valid_for=valid_for,
            window_end_ms=window_end_ms,
            static_friction=static_friction or Bounded.exact(valve.static_friction),
            dynamic_friction=dynamic_friction or Bounded.exact(valve.dynamic_friction),
            stick_band=stick_band or Bounded.exact(valve.stick_band),
            slip_jump=slip_jump or Bounded.exact(valve.slip_jump),
            confidence=confidence,
            smoothing=smoothing,
            process=model.process,
            verdict=Verdict.STICTION,
            windows=windows,
            samples=samples,
            fit=fit,
            evidence=evidence,
        )

    @property
    def valve(self) -> ValveModel:
        """The valve model of the block."""
        return ValveModel(stick_band=self.stick_band.value, slip_jump=self.slip_jump.value)

    @property
    def model(self) -> LoopModel | None:
        """Valve and process for a controller; None without a process or a valid status."""
        if self.status is not Status.VALID or self.process is None:
            return None
        return LoopModel(self.valve, self.process)

    @property
    def gain(self) -> float:
        """Steady-state gain, PV per OP (and second when integrating); 0 without a process."""
        return 0.0 if self.process is None else block_gain(self.process)

    @property
    def time_constant(self) -> float:
        """Time constant (s) of the slowest pole that is not an integrator; 0 without one."""
        return 0.0 if self.process is None else _time_constant(self.process)

    def _check_valve(self) -> None:
        for name in ("static_friction", "dynamic_friction", "stick_band", "slip_jump"):
            bounded: Bounded = getattr(self, name)
            for end in (bounded.low, bounded.value, bounded.high):
                _require_float32(name, end)
            _require(
                0.0 <= bounded.low <= bounded.value <= bounded.high,
                f"{name}: 0 <= {bounded.low:g} <= {bounded.value:g} <= {bounded.high:g} fails",
            )
        S, J = self.stick_band.value, self.slip_jump.value
        _require(J <= S, f"slip_jump = {J:g} above stick_band = {S:g}")
        fS, fD = self.static_friction.value, self.dynamic_friction.value
        # A thousandth: far above the rounding of a float32, far below what a control loop notices.
        close = 1e-3 * S
        _require(
            abs(fS + fD - S) <= close and abs(fS - fD - J) <= close,
            f"fS = {fS:g}, fD = {fD:g} do not belong to S = {S:g}, J = {J:g}",
        )
        _require(self.status is not Status.VALID or S > 0.0, "a valid block with stick_band = 0")


def next_seq(seq: int) -> int:
    """Return the sequence number after ``seq``: 1 after 65535 and after 0 (none yet)."""
    return seq % _SEQ_LAST + 1


def is_newer(seq: int, than: int) -> bool:
    """Whether ``seq`` comes after ``than`` on the circle of the numbers 1 to 65535.

    At most half the circle ahead counts as newer, so an old block is not taken for a new one. Every
    number is newer than 0, which stands for nothing accepted yet.
    """
    return than == 0 or 1 <= (seq - than) % _SEQ_LAST <= _SEQ_LAST // 2


def _check_process(process: ProcessModel) -> None:
    for name, values in (("a", process.a), ("b", process.b)):
        _require(
            len(values) <= MAX_COEFFICIENTS,
            f"{len(values)} coefficients {name}, limit {MAX_COEFFICIENTS}",
        )
    _require(process.dead_time <= 0xFFFF, f"dead_time = {process.dead_time}")
    _require_float32("offset", process.offset)
    _require_float32("gain", block_gain(process))
    _require(1e-6 <= process.period <= 1e9, f"period = {process.period} s, limit 1e-6 to 1e9")


def block_gain(process: ProcessModel) -> float:
    """Steady-state gain, or the slope of PV per OP and second of an integrating process."""
    if not process.is_integrating:
        return process.gain
    # A(1) = 0, so dA/dz^-1 at 1 gives the residue of the pole at 1.
    slope = -sum((i + 1) * value for i, value in enumerate(process.a))
    if slope == 0.0:
        return math.inf
    return sum(process.b) / (slope * process.period)


def _time_constant(process: ProcessModel) -> float:
    moduli = np.abs(np.roots([1.0, *process.a])) if process.a else np.empty(0)
    inside = moduli[(moduli > 0.0) & (moduli < 1.0 - 1e-6)]
    if inside.size == 0:
        return 0.0
    return float(-process.period / np.log(inside.max()))


def _require(condition: bool, detail: str) -> None:
    if not condition:
        raise BlockError(BlockFault.OUT_OF_RANGE, detail)


def _require_float32(name: str, value: float) -> None:
    _require(abs(value) <= _FLOAT32_MAX, f"{name} = {value}, not a number a REAL can hold")
