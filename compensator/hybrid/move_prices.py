"""What a move of the stem must gain in PV: a price, set from the noise that the loop shows.

An error that noise explains is not worth a move, nor is a small share of what PV deviated by before
compensation. `Thrift` changes the price where PV and travel can be bought with each other.
"""

from __future__ import annotations

from compensator.hybrid.settings import HybridSettings
from compensator.hybrid.thrift import Thrift
from compensator.prediction import Prediction
from compensator.stem_tracking.stem import StemTracker

__all__ = ["MovePrices"]

_LEAST_PV = 1e-3
"""Floor of the deviation that is worth a move, for loops without noise: a thousandth of what one
slip makes of PV.
"""


class MovePrices:
    """The price of a move and of its size.

    Args:
        settings: penalties and shares.
        prediction: the process.
        duration: samples that a plan sums up PV squared over.
    """

    def __init__(self, settings: HybridSettings, prediction: Prediction, duration: float) -> None:
        self._settings, self._prediction, self._duration = settings, prediction, duration
        self._tolerated = 0.0
        self._thrift: Thrift | None = None

    def improve_on(self, deviation: float, travel: float, horizon: int) -> None:
        """Take in what the loop was like before; see `HybridMpc.improve_on`."""
        s = self._settings
        share = s.tolerated_level if self._prediction.process.is_integrating else s.tolerated
        self._tolerated = share * deviation
        self._thrift = Thrift(deviation, travel, horizon, s.thrift)

    def follow(self, tracker: StemTracker, sp: float, way: float, *, in_reach: bool) -> None:
        """Take in a scan: belief, set-point, way of the stem, whether SP is in OP's reach."""
        if self._thrift is None:
            return
        if not in_reach:  # no travel brings PV there
            self._thrift.restart()
        else:
            self._thrift.push(float(tracker.best.state[0]), sp, way, tracker.carried_variance)

    def of_move(self, tracker: StemTracker, smallest: float) -> tuple[float, float]:
        """Return the price of a move and of its size, in PV squared times samples.

        Args:
            tracker: what is believed.
            smallest: move that is planned, in OP.
        """
        s, prediction = self._settings, self._prediction
        # An offset not yet known well is no reason to move: waiting will tell.
        # A level drifts away from a wrong position, so that there a move cannot wait.
        weight = 1.0 if prediction.process.is_integrating else s.unknown
        variance = tracker.held_variance + weight * tracker.offset_variance + s.noise_band**2
        variance = max(variance, self._tolerated**2)
        if self._thrift is not None:
            variance *= self._thrift.price
        if tracker.best.direction == 0.0:
            variance *= s.unseen
        floor = (_LEAST_PV * prediction.scale * max(smallest, 1e-3)) ** 2
        move_cost = s.move_penalty * max(variance, floor) * self._duration
        size = max(smallest, tracker.valve.static_friction, 1e-9)
        return move_cost, s.travel_penalty * move_cost / size
