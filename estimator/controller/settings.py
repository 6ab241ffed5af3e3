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
        shifts: samples by which PV or OP may be stored later than the other one: a historian that
            polls one after the other is late by a scan or two.
        sharp: factor by which the second best shift leaves more of OP's moves than the best, from
            which that is taken (tuning family with noise of 2 to 20 % on OP and PV: where nothing
            was shifted below 1.1 for all of 396 records).
        integral: nats that integral action must add to such a match where nothing else tells that
            it is the controller's: the estimator's threshold. PV that answers OP at once matches as
            well, and its level then tells nothing of OP's moves.
    """

    least_rows: int = 40
    exact: float = 0.97
    resolution: float = 1e-7
    reaches: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    least_explained: float = 0.3
    shifts: int = 3
    sharp: float = 1.2
    integral: float = 10.0


READING = Reading()
