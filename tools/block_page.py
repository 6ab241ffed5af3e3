"""The page of a parameter block's registers and codes, from the program's own tables."""

from __future__ import annotations

from fieldlink.registers import (
    ACCEPTED,
    BLOCK_FIELDS,
    NOTHING_SEEN,
    BlockFault,
    Refusal,
    describe_ack,
)
from tools.tables import markdown_table

__all__ = ["block_page"]

_HEAD = """# Registers and codes of a parameter block

What the registers mean together, and the reader's rules, are in
[the parameter block](../parameter-block.md).

## Registers

Offsets are in registers from the block's first. WORD is one register, UDINT and REAL are two,
ULINT and LREAL four.
"""

_RESULTS = """
## Result codes

`ack_result` gives the outcome of the block last committed.
"""

_REFUSALS = """
## Refusals

`ack_refusal` says why the controller refuses or gave up the model of an accepted block; 0: it does
not.
"""

_PLC_TYPES = {
    "uint16": "WORD",
    "uint32": "UDINT",
    "uint64": "ULINT",
    "float32": "REAL",
    "float64": "LREAL",
}


def block_page() -> str:
    """Return the page in Markdown."""
    registers = [
        (str(field.offset), field.name, _PLC_TYPES[field.data_type], field.unit, field.text)
        for field in BLOCK_FIELDS
    ]
    codes = [NOTHING_SEEN, ACCEPTED, *(fault.code for fault in BlockFault)]
    results = [(str(code), describe_ack(code).removeprefix("rejected: ")) for code in codes]
    refusals = [(str(one.code), f"{one.text}; {one.advice}") for one in Refusal]
    return (
        "\n".join(
            (
                _HEAD,
                markdown_table(("offset", "name", "type", "unit", "meaning"), registers)
                + _RESULTS.rstrip(),
                "",
                markdown_table(("code", "meaning"), results) + _REFUSALS.rstrip(),
                "",
                markdown_table(("refusal", "meaning"), refusals),
            )
        ).rstrip("\n")
        + "\n"
    )
