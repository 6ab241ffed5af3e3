"""Columns of quality: which of their words or codes mean a good value.

find_good(["Good", "Bad", "Good, annotated"])  # True, False, True
find_good(["192", "0"])                        # True, False: OPC Data Access
find_good(["0", "2147483648"])                 # True, False: OPC UA
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fieldlink.site.number_cells import plain_number

__all__ = ["find_good"]

_GOOD_WORDS = frozenset({"good", "ok", "g", "valid", "true", "normal"})
_OPC_GOOD = 192
"""Least code of a good value in OPC Data Access, where 0 is bad."""
_OPC_UA_NOT_GOOD = 1 << 30
"""Least status code of OPC UA that is not good: its two highest bits of 32 are the severity, and 0
is good."""
_OPC_UA_FROM = 1 << 16
"""Least code that only OPC UA has: those of OPC Data Access have 16 bits."""


def find_good(cells: Sequence[str]) -> NDArray[np.bool_] | None:
    """Return whether each cell means good, an empty one not; None where that is not known."""
    folded = [cell.casefold() for cell in cells]
    known = set(folded) - {""}
    good = {cell for cell in known if cell in _GOOD_WORDS or cell.startswith("good")}
    if not good:
        try:
            codes = {cell: _code(cell) for cell in known}
        except ValueError:
            return None
        largest = max(codes.values(), default=0)
        if largest >= _OPC_UA_FROM:
            good = {cell for cell, code in codes.items() if code < _OPC_UA_NOT_GOOD}
        elif largest >= _OPC_GOOD:
            good = {cell for cell, code in codes.items() if code >= _OPC_GOOD}
        else:
            return None
    return np.array([cell in good for cell in folded], dtype=np.bool_)


def _code(cell: str) -> int:
    """A code; one of 32 bits may stand as a negative number."""
    code = int(cell, 16) if cell.startswith("0x") else int(plain_number(cell))
    return code % (1 << 32)
