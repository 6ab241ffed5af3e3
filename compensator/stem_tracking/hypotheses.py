"""The few hypotheses of one tracker: what a command and a PV make of them, which are kept."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from compensator.prediction import Prediction
from compensator.stem_tracking.belief import ERRORS, FRICTION, GAIN, Belief
from compensator.stem_tracking.hypothesis_kernels import (
    COLUMNS,
    DIRECTION,
    NOISE,
    SCORE,
    STEM,
    SURVIVED,
    TESTED,
    TURN,
    WAY,
    correct,
    keep_likely,
    move,
)
from compensator.stem_tracking.tracker_settings import TrackerSettings
from loop_model import ValveModel

__all__ = ["RECALLED", "Hypotheses"]

Array = NDArray[np.float64]

RECALLED = 4
"""Earlier positions that can be believed again at once: the corners of a cycle, and one more."""


class Hypotheses:
    """Hypotheses, best first; empty before `start`.

    They are kept in arrays that compiled loops work on (`hypothesis_kernels`): a bank has some
    sixteen trackers, and each scan moves, weighs and ranks all hypotheses of all of them.

    Args:
        prediction: the process with its disturbance at the input.
        settings: uncertainties.
    """

    def __init__(self, prediction: Prediction, settings: TrackerSettings) -> None:
        self._prediction, self._settings = prediction, settings
        self._n = prediction.order
        rows = 2 * max(settings.hypotheses, len(settings.first)) + RECALLED
        self._values = np.zeros((rows, COLUMNS))
        self._points = np.zeros((rows, self._n + ERRORS))
        self._spread = np.zeros((self._n + ERRORS, self._n + ERRORS))
        self._law = settings.friction.law(settings.negligible)
        self._valve: ValveModel | None = None
        self._friction = (0.0, 0.0, 0.0)
        self._ranking = (settings.alike, settings.hopeless, settings.hypotheses)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def stem(self) -> float:
        """Position of the best one."""
        return self._values.item(0, STEM)

    @property
    def direction(self) -> float:
        """Direction of the last slip of the best one."""
        return self._values.item(0, DIRECTION)

    @property
    def slip(self) -> tuple[float, float]:
        """Changes of position and of direction by this scan's slip of the best one."""
        return self._values.item(0, WAY), self._values.item(0, TURN)

    @property
    def stems(self) -> list[float]:
        """Their positions."""
        stems: list[float] = self._values[: self._count, STEM].tolist()
        return stems

    @property
    def chances(self) -> list[float]:
        """How likely each is; they sum up to 1."""
        scores = self._values[: self._count, SCORE].tolist()
        best = max(scores)
        odds = [math.exp(score - best) for score in scores]
        total = math.fsum(odds)
        return [o / total for o in odds]

    def belief(self, rank: int = 0) -> Belief:
        """Return the hypothesis of that rank, 0 for the best one, as it is now."""
        if not 0 <= rank < self._count:
            raise IndexError(f"there are {self._count} hypotheses; got rank {rank}")
        row, point = self._values[rank], self._points[rank].copy()
        return Belief(
            float(row[STEM]),
            float(row[DIRECTION]),
            point[: self._n],
            point[self._n :],
            float(row[NOISE]),
            float(row[SURVIVED]),
            float(row[WAY]),
        )

    def clear(self) -> None:
        """Believe nothing."""
        self._count = 0

    def start(self, pv: float, op: float, valve: ValveModel) -> None:
        """Begin with a loop at rest at ``pv``: the stem is anywhere in the band around ``op``."""
        fs = valve.static_friction
        state, drive = self._prediction.equilibrium(pv, 0.0)
        self._count = 0
        for share in self._settings.first if fs > 0.0 else (0.0,):
            stem = op + share * fs
            errors = (drive - op - share * fs, 0.0, self._settings.gain - 1.0)
            self._append(stem, 0.0, -0.5 * abs(share), state, errors)

    def move(self, op: float, valve: ValveModel) -> Array | None:
        """Go on by one scan under ``op``.

        Returns:
            The spread of those that were merged into the best one, shape ``(n + 3, n + 3)``: what
            it adds to the covariance. None if none were.
        """
        p = self._prediction
        self._count, merged = move(
            self._values,
            self._points,
            self._count,
            op,
            *self._frictions_of(valve),
            self._law,
            p.A,
            p.B,
            p.equation_gain,
            *self._ranking,
            self._spread,
        )
        return self._spread if merged else None

    def correct(
        self,
        pv: float,
        innovation: float,
        farthest: float,
        gain: Array,
        carried: float,
        valve: ValveModel,
    ) -> float:
        """Take in PV and return the surprise of the best one.

        Args:
            pv: of this scan; innovation: its expected variance; farthest: largest surprise counted.
            gain: of the filter, shape ``(n + 3,)``.
            carried: share of the surprise that goes on as equation noise.
            valve: the valve model. The errors of fD and of the gain stay plausible: within half of
                what is expected.
        """
        expected = self._settings.gain
        self._count, surprise = correct(
            self._values,
            self._points,
            self._count,
            pv,
            innovation,
            farthest,
            gain,
            carried,
            self._settings.memory,
            0.5 * expected * self._frictions_of(valve)[1],
            0.5 * expected - 1.0,
            1.5 * expected - 1.0,
            *self._ranking,
        )
        return surprise

    def _frictions_of(self, valve: ValveModel) -> tuple[float, float, float]:
        """Return fS, fD and the deviation of fS: of one valve for many scans."""
        if valve is not self._valve:
            self._valve = valve
            deviation = self._settings.friction.static_deviation(valve)
            self._friction = (valve.static_friction, valve.dynamic_friction, deviation)
        return self._friction

    def forget_errors(self) -> None:
        """Go back to no error of fD and to the gain that is expected."""
        self._points[: self._count, self._n + FRICTION] = 0.0
        self._points[: self._count, self._n + GAIN] = self._settings.gain - 1.0

    def recall(self, rests: Iterable[tuple[float, float]], op: float, reach: float) -> None:
        """Believe again in earlier positions, with the direction of the slip that led there, unless
        ``op`` is farther than ``reach`` from them.
        """
        best, score = self.belief(), float(self._values[0, SCORE])
        for stem, direction in rests:
            if abs(stem - best.stem) > 1e-9 and abs(op - stem) <= reach:
                against = self._settings.recalled
                self._append(stem, direction, score - against, best.state, best.errors)
                self._values[self._count - 1, NOISE] = best.noise
        self._count, _ = keep_likely(self._values, self._points, self._count, *self._ranking)

    def _append(
        self,
        stem: float,
        direction: float,
        score: float,
        state: Array,
        errors: Iterable[float],
    ) -> None:
        row, point = self._values[self._count], self._points[self._count]
        row[:] = 0.0
        row[STEM], row[DIRECTION], row[SCORE] = stem, direction, score
        row[SURVIVED] = row[TESTED] = -math.inf
        point[: self._n] = state
        point[self._n :] = tuple(errors)
        self._count += 1
