"""Every chosen number of reading a controller, with its reason."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["READING", "Reading"]


@dataclass(frozen=True, slots=True)
class Reading:
    """How the controller is read off the record.

    Attributes:
        least_rows: fewer usable rows do not tell four unknowns.
        exact: share of OP's moves from which the record is what the controller saw.
        resolution: share of the moves' variance that rounding of a record leaves at least.
        reaches: samples over which noisy records are summed.
        least_explained: share of OP's moves below which OP does not answer the error.
    """

    least_rows: int = 40
    exact: float = 0.97
    resolution: float = 1e-7
    reaches: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    least_explained: float = 0.3


READING = Reading()
