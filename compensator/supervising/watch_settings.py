"""What can be set of the watch over a compensated loop."""

from __future__ import annotations

from dataclasses import dataclass, field

from compensator.action import CompensatorError, require_not_negative, require_positive
from compensator.supervising.cycles import CycleSettings
from compensator.supervising.harm import HarmSettings
from compensator.supervising.promise import PromiseSettings

__all__ = ["WatchSettings"]


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """Settings of `LoopWatch`.

    Attributes:
        worse_by: factor of PV's mean square error over the long window, against before, that is
            too much.
        much_worse: the same over the short window.
        at_rest: factor by which more is allowed while the stem travels less than a tenth of before:
            what PV does then is noise, or a load about to be compensated.
        quiet: multiple of the variance that noise alone makes which never counts as worse: three
            deviations.
        moving: the same while the stem travels: the variance of the some ten values of a slow noise
            that a window holds is known to a factor of two.
        travel_budget: factor of the stem's travel, against before, that is too much over the long
            window; over the short one it is half as much again, over the quick one three times.
        hunting: factor of the stem's travel that is too much while PV is no better than
            ``hunting_share`` of its mean square before.
        hunting_share: see ``hunting``.
        harm: what is too much of both, PV's deviation and travel.
        pv_trip: multiple of the largest error known beyond which PV must return at once.
        trip_scans: scans beside the dead time that PV may be beyond it: an error that grows for so
            long is none that the last move has yet to answer.
        trip_latest: scans after which PV may be beyond it no longer, whatever the dead time is.
        limit_trip: the same multiple as ``pv_trip`` while OP is at a limit and PV is leaving.
        unexplained: largest share of PV's variance, since its range was left, that a step of the
            load and the answer to the stem may leave unexplained for the load to be the reason: one
            that a wrong model has made leaves more, or less when the answer is turned round.
        periods: of the oscillation before: length of the quick, the short and the long window.
        least: samples of the quick window at least.
        persist: share of the short window for which a verdict of the windows must hold.
        stepped: share of the largest error known from which a change of the set-point is a step to
            be settled; a smaller one is to be followed inside the known range.
        cycles: what an oscillation that grows is.
        promise: what compensation must reach in the long run.
    """

    worse_by: float = 1.05
    much_worse: float = 1.8
    at_rest: float = 2.0
    quiet: float = 9.0
    moving: float = 2.0
    travel_budget: float = 2.0
    hunting: float = 1.5
    hunting_share: float = 0.8
    harm: HarmSettings = field(default_factory=HarmSettings)
    pv_trip: float = 3.0
    trip_scans: int = 8
    trip_latest: int = 60
    limit_trip: float = 1.5
    unexplained: float = 0.05
    periods: tuple[float, float, float] = (1.5, 2.5, 4.5)
    least: int = 40
    persist: float = 0.125
    stepped: float = 0.5
    cycles: CycleSettings = field(default_factory=CycleSettings)
    promise: PromiseSettings = field(default_factory=PromiseSettings)

    def __post_init__(self) -> None:
        require_positive(
            "WatchSettings",
            worse_by=self.worse_by,
            much_worse=self.much_worse,
            at_rest=self.at_rest,
            travel_budget=self.travel_budget,
            hunting=self.hunting,
            pv_trip=self.pv_trip,
            limit_trip=self.limit_trip,
            trip_scans=self.trip_scans,
            trip_latest=self.trip_latest,
            least=self.least,
            stepped=self.stepped,
            quick=self.periods[0],
        )
        require_not_negative(
            "WatchSettings",
            quiet=self.quiet,
            moving=self.moving,
            hunting_share=self.hunting_share,
            persist=self.persist,
        )
        if not self.periods[0] <= self.periods[1] <= self.periods[2]:
            raise CompensatorError(
                f"WatchSettings: the windows' periods must not fall; got {self.periods!r}"
            )
