"""What a loop was like under its own controller: the figures that compensation is compared with."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from compensator.action import require_not_negative, require_positive, require_whole
from loop_model import ValveModel

__all__ = ["FiguresSettings", "LoopFigures", "LoopRecord", "Sample", "oscillation_period"]


@dataclass(frozen=True, slots=True)
class FiguresSettings:
    """Settings of a loop's figures.

    Attributes:
        shortest_period: samples; what oscillates faster is noise.
        steady: samples of a stretch at least, the way to a new set-point left out.
        turned: root mean squares of the error beyond zero from which its sign has changed.
    """

    shortest_period: int = 12
    steady: int = 30
    turned: float = 0.5

    def __post_init__(self) -> None:
        require_whole(
            "FiguresSettings", 1, shortest_period=self.shortest_period, steady=self.steady
        )
        require_not_negative("FiguresSettings", turned=self.turned)


SETTINGS = FiguresSettings()
"""The settings in use."""


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """A loop under its base controller.

    Attributes:
        mean_square: of PV minus SP.
        travel: of the stem per sample, by the valve model: OP's own is that of noise as well.
        period: of its oscillation, samples.
        largest: error seen.
    """

    mean_square: float
    travel: float
    period: float
    largest: float

    def __post_init__(self) -> None:
        require_not_negative(
            "LoopFigures", mean_square=self.mean_square, travel=self.travel, largest=self.largest
        )
        require_positive("LoopFigures", period=self.period)


def oscillation_period(errors: Sequence[float], otherwise: float) -> float:
    """Return the mean period of an error, in samples; ``otherwise`` where it has no three turns.

    Its sign has changed once it is `FiguresSettings.turned` root mean squares beyond zero.
    """
    level = SETTINGS.turned * math.sqrt(math.fsum(e * e for e in errors) / max(1, len(errors)))
    side, turns = 0.0, []
    for k, error in enumerate(errors):
        if abs(error) > level and math.copysign(1.0, error) != side:
            if side:
                turns.append(k)
            side = math.copysign(1.0, error)
    if len(turns) < 3:
        return otherwise
    return max(float(SETTINGS.shortest_period), 2.0 * (turns[-1] - turns[0]) / (len(turns) - 1))


@dataclass(frozen=True, slots=True)
class Sample:
    """One scan: PV, SP, the OP applied before it, and whether the base controller had the loop."""

    pv: float
    sp: float
    op: float
    by_base: bool


class LoopRecord:
    """The latest scans of a loop under any controller.

    Args:
        length: scans that are kept.
    """

    def __init__(self, length: int) -> None:
        self._samples: deque[Sample] = deque(maxlen=length)

    def __len__(self) -> int:
        """Return the number of scans that are kept."""
        return len(self._samples)

    def push(self, sample: Sample) -> None:
        """Take in a scan."""
        self._samples.append(sample)

    def replace(self, samples: Iterable[Sample]) -> None:
        """Keep other samples instead."""
        self._samples = deque(samples, self._samples.maxlen)

    @property
    def all(self) -> list[Sample]:
        """Every scan that is kept, oldest first."""
        return list(self._samples)

    def latest(self, count: int) -> list[Sample]:
        """Return the last ``count`` scans, oldest first."""
        return list(self._samples)[-count:]

    def figures(self, window: int, least: int, valve: ValveModel) -> LoopFigures | None:
        """Return the figures of the base controller, None if it had the loop too shortly.

        All stretches without a change of set-point that are two windows long count together: a
        sticky valve may rest for a while by luck and cycle again after the next disturbance. Else
        the longest counts; else, where the set-point moves all the time, the longest at all.

        Args:
            window: samples that a set-point change takes to settle, times two.
            least: samples that are needed.
            valve: by which OP moves the stem.
        """
        steady = self._stretches(any_setpoint=False)
        left = [s if k == 0 else s[window // 2 :] for k, s in enumerate(steady)]
        # The model may know nothing of a loop that takes long to arrive.
        arrived = [s if k == 0 else _arrived(s) for k, s in enumerate(left)]
        enough = max(least, SETTINGS.steady)
        settled = [s for s in arrived if len(s) >= enough]
        if not settled:
            settled = [s for s in left if len(s) >= enough]
        if not settled:
            settled = [s for s in self._stretches(any_setpoint=True) if len(s) >= least]
        if not settled:
            return None
        long = [s for s in settled if len(s) >= 2 * window]
        return _figures_of(long or [max(settled, key=len)], window, least, valve)

    def _stretches(self, *, any_setpoint: bool) -> list[list[Sample]]:
        stretches: list[list[Sample]] = [[]]
        last: Sample | None = None
        for sample in self._samples:
            moved = last is not None and sample.sp != last.sp and not any_setpoint
            if not sample.by_base or moved:
                stretches.append([])
            if sample.by_base:
                stretches[-1].append(sample)
            last = sample
        return stretches


def _figures_of(
    stretches: Sequence[Sequence[Sample]], window: int, least: int, valve: ValveModel
) -> LoopFigures | None:
    errors = [[s.pv - s.sp for s in stretch if math.isfinite(s.pv)] for stretch in stretches]
    known = sum(map(len, errors))
    if known < least:
        return None
    squares = [math.fsum(e * e for e in part) for part in errors]
    # The stretch with most of the deviation has the oscillation; one at rest has noise's period.
    main = errors[squares.index(max(squares))]
    return LoopFigures(
        math.fsum(squares) / known,
        math.fsum(_travel_in(stretch, valve) for stretch in stretches) / sum(map(len, stretches)),
        min(oscillation_period(main, window), max(0.5 * len(main), window)),
        max(abs(e) for part in errors for e in part),
    )


def _arrived(stretch: list[Sample]) -> list[Sample]:
    """Return a stretch from where its error first changes its sign: before, it is the way to the
    set-point. One whose error never does is returned whole.
    """
    side = 0.0
    for k, sample in enumerate(stretch):
        error = sample.pv - sample.sp
        if error * side < 0.0:
            return stretch[k:]
        if not side and math.isfinite(error):
            side = error
    return stretch


def _travel_in(stretch: Sequence[Sample], valve: ValveModel) -> float:
    """Return the way of the stem in a stretch, by the valve model."""
    stem = valve.simulate([s.op for s in stretch], stretch[0].op)
    return math.fsum(abs(b - a) for a, b in itertools.pairwise(stem.tolist()))
