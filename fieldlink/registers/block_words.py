"""Parameter blocks to registers and back.

Registers that read zero (a PLC's Modbus server after a time-out, memory after a cold start) are no
block: `decode_block` answers `BlockFault.EMPTY`.
"""

from __future__ import annotations

from collections.abc import Sequence

from fieldlink.registers.block_layout import (
    BLOCK_REGISTERS,
    LAYOUT_VERSION,
    MAGIC,
    MAX_COEFFICIENTS,
    pack,
    unpack,
)
from fieldlink.registers.codes import BlockError, BlockFault, Status, Verdict
from fieldlink.registers.crc import crc16
from fieldlink.registers.parameter_block import Bounded, ParameterBlock
from fieldlink.registers.types import Order
from loop_model import ProcessModel

__all__ = ["decode_block", "encode_block", "read_seq"]

_NO_PROCESS, _SELF_REGULATING, _INTEGRATING = _KINDS = (0, 1, 2)


def encode_block(block: ParameterBlock, word_order: Order = "big") -> list[int]:
    """Return the block's `BLOCK_REGISTERS` words, CRC and sequence words included."""
    process = block.process
    a = process.a if process else ()
    b = process.b if process else ()
    values: dict[str, float] = {
        "magic": MAGIC,
        "version": LAYOUT_VERSION,
        "loop_id": block.loop_id,
        "seq": block.seq,
        "status": block.status,
        "length": BLOCK_REGISTERS,
        "valid_for": block.valid_for,
        "window_end": block.window_end_ms,
        "confidence": block.confidence,
        "smoothing": block.smoothing,
        "period": process.period if process else 0.0,
        "dead_time": process.dead_time if process else 0,
        "na": len(a),
        "nb": len(b),
        "process_kind": _kind(process),
        "offset": process.offset if process else 0.0,
        "gain": block.gain,
        "time_constant": block.time_constant,
        "verdict": block.verdict,
        "windows": block.windows,
        "samples": block.samples,
        "fit": block.fit,
        "evidence": block.evidence,
        "crc": 0,
        "seq_again": block.seq,
    }
    for name in ("static_friction", "dynamic_friction", "stick_band", "slip_jump"):
        bounded: Bounded = getattr(block, name)
        values[name], values[f"{name}_low"], values[f"{name}_high"] = (
            bounded.value,
            bounded.low,
            bounded.high,
        )
    for i in range(MAX_COEFFICIENTS):
        values[f"a{i + 1}"] = a[i] if i < len(a) else 0.0
        values[f"b{i + 1}"] = b[i] if i < len(b) else 0.0
    words = pack(values, word_order)
    words[-2] = crc16(words[:-2])
    return words


def read_seq(words: Sequence[int]) -> int:
    """Return the sequence number of a block that arrived whole; its content is not looked at.

    Raises:
        BlockError: it is empty, no block of this layout, or torn.
    """
    if len(words) != BLOCK_REGISTERS:
        raise BlockError(BlockFault.VERSION, f"{len(words)} registers, not {BLOCK_REGISTERS}")
    if not any(words):
        raise BlockError(BlockFault.EMPTY)
    magic, version, _, seq, _, length = words[:6]
    crc, seq_again = words[-2:]
    if magic != MAGIC:
        raise BlockError(BlockFault.MAGIC, f"it is 16#{magic:04X}")
    # Before the CRC, whose place depends on the layout.
    if version != LAYOUT_VERSION or length != BLOCK_REGISTERS:
        raise BlockError(BlockFault.VERSION, f"version {version}, length {length}")
    if crc16(words[:-2]) != crc:
        raise BlockError(BlockFault.CRC)
    if seq != seq_again:
        raise BlockError(BlockFault.SEQ_TORN, f"{seq} and {seq_again}")
    if seq == 0:
        raise BlockError(BlockFault.SEQ_ZERO)
    return seq


def decode_block(words: Sequence[int], word_order: Order = "big") -> ParameterBlock:
    """Return the block that ``words`` hold.

    Raises:
        BlockError: with the `BlockFault` that a PLC would acknowledge; `NOT_NEWER`, `WRONG_LOOP`,
            `NOT_ENABLED` and `COMMIT` are the reader's to find.
    """
    seq = read_seq(words)
    field = unpack(words, word_order)
    try:
        status = Status(int(field["status"]))
        verdict = Verdict(int(field["verdict"]))
    except ValueError as error:
        raise BlockError(BlockFault.STATUS, str(error)) from error
    return ParameterBlock(
        loop_id=int(field["loop_id"]),
        seq=seq,
        status=status,
        valid_for=int(field["valid_for"]),
        window_end_ms=int(field["window_end"]),
        static_friction=_bounded_of(field, "static_friction"),
        dynamic_friction=_bounded_of(field, "dynamic_friction"),
        stick_band=_bounded_of(field, "stick_band"),
        slip_jump=_bounded_of(field, "slip_jump"),
        confidence=field["confidence"],
        smoothing=field["smoothing"],
        process=_process_of(field),
        verdict=verdict,
        windows=int(field["windows"]),
        samples=int(field["samples"]),
        fit=field["fit"],
        evidence=field["evidence"],
    )


def _bounded_of(field: dict[str, float], name: str) -> Bounded:
    return Bounded(field[name], field[f"{name}_low"], field[f"{name}_high"])


def _process_of(field: dict[str, float]) -> ProcessModel | None:
    na, nb, kind = int(field["na"]), int(field["nb"]), int(field["process_kind"])
    if na > MAX_COEFFICIENTS or nb > MAX_COEFFICIENTS:
        raise BlockError(BlockFault.OUT_OF_RANGE, f"na = {na}, nb = {nb}")
    if kind not in _KINDS or (kind == _NO_PROCESS) != (nb == 0):
        raise BlockError(BlockFault.OUT_OF_RANGE, f"process_kind = {kind}, nb = {nb}")
    if kind == _NO_PROCESS:
        return None
    try:
        return ProcessModel(
            a=tuple(field[f"a{i + 1}"] for i in range(na)),
            b=tuple(field[f"b{i + 1}"] for i in range(nb)),
            dead_time=int(field["dead_time"]),
            offset=field["offset"],
            # A REAL near 0.1 is 0.1: the period is compared with configured ones.
            period=float(f"{field['period']:.7g}"),
        )
    except ValueError as error:
        raise BlockError(BlockFault.OUT_OF_RANGE, str(error)) from error


def _kind(process: ProcessModel | None) -> int:
    if process is None:
        return _NO_PROCESS
    return _INTEGRATING if process.is_integrating else _SELF_REGULATING
