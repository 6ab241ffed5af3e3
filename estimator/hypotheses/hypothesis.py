"""One explanation of a window: valve, process, nuisances and noise, and how likely it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from estimator.arrays import Array, Index, Mask
from estimator.hypotheses.linear_fit import Design, LinearFit, fit_linear
from estimator.hypotheses.noise import fit_noise, orders_of
from estimator.hypotheses.nuisances import (
    FEWEST_CYCLES,
    Characteristic,
    Nuisance,
    Sinusoid,
    columns_of,
    price_of,
    spectral_peaks,
)
from estimator.hypotheses.periodic_load import PeriodicLoad
from estimator.hypotheses.turns import fit_in_turn
from estimator.lanes import tells
from estimator.processes.poles import SHAPE_NUMBERS, Poles, Shape, pole_prices
from estimator.rows import Rows
from estimator.settings import Settings
from estimator.valves.laws import stem_of

__all__ = ["Case", "Hypothesis", "Valve", "likelier"]

_KEPT = 8
"""Columns and designs of a window that are kept: those of the hypotheses that are refined now."""
_NO_ORDERS: Index = np.zeros(0, dtype=np.int64)

_Made = TypeVar("_Made")


@dataclass(frozen=True, slots=True)
class Valve:
    """A sticky valve in shares of OP's span: S, J, the stem before the window, and its law."""

    band: float
    jump: float
    start: float
    law: str = "he"

    @property
    def numbers(self) -> tuple[float, float, float]:
        """S, J and the start."""
        return self.band, self.jump, self.start

    def stem(self, op: Array) -> Array:
        """Its stem, ``(n,)``."""
        return stem_of(op, self.law, self.numbers)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An explanation of the window, fitted.

    Attributes:
        valve: None is a healthy valve.
        poles, dead_time: the process.
        nuisances: what else is in PV.
        taps: the noise model, ``(p,)``.
        gains: of the responses at the dead time and one sample later, ``(2,)``.
        squares: sum of squares of the innovations.
        residual: what is left of PV, not whitened, ``(n,)``.
        likelihood: log-likelihood less what its parameters cost (BIC), in nats.
        stem: the stem, ``(n,)``.
    """

    valve: Valve | None
    poles: Poles
    dead_time: int
    nuisances: tuple[Nuisance, ...]
    taps: Array
    gains: Array
    squares: float
    residual: Array
    likelihood: float
    stem: Array

    @property
    def gain(self) -> float:
        """Gain of the process in scaled units."""
        return float(self.gains.sum())

    @property
    def waves(self) -> tuple[Sinusoid | PeriodicLoad, ...]:
        """The oscillations that it needs from outside."""
        return tuple(one for one in self.nuisances if isinstance(one, Sinusoid | PeriodicLoad))

    @property
    def outside(self) -> tuple[Nuisance, ...]:
        """All that it needs from outside: oscillations and loads."""
        return tuple(one for one in self.nuisances if not isinstance(one, Characteristic))

    @property
    def disturbances(self) -> int:
        """How many oscillations and loads it needs from outside."""
        return len(self.outside)


_ALIKE = 1e-6
"""Nats within which two hypotheses are as likely: rounding decides nothing."""


def likelier(one: Hypothesis, other: Hypothesis) -> Hypothesis:
    """The likelier one; the first in a tie."""
    return other if other.likelihood > one.likelihood + _ALIKE else one


@dataclass(frozen=True)
class Case:
    """The rows of a window with the settings: what every hypothesis is judged by."""

    rows: Rows
    settings: Settings

    @cached_property
    def max_dead_time(self) -> int:
        """Longest dead time that the rows leave past for."""
        longest_noise = max(self.settings.modelling.noise_orders)
        return max(
            self.rows.soonest,
            min(self.settings.modelling.max_dead_time, self.rows.first - longest_noise - 2),
        )

    @cached_property
    def own_cycles(self) -> float | None:
        """Cycles of PV's own oscillation in the window; None where PV does not oscillate."""
        cycles = spectral_peaks(self.rows.y * self.rows.weight, 1)[0]
        return cycles if cycles >= FEWEST_CYCLES else None

    def stem(self, valve: Valve | None) -> Array:
        """The stem of a valve; a healthy one's is OP."""
        return self.rows.u if valve is None else valve.stem(self.rows.u)

    @cached_property
    def works(self) -> tuple[int, float]:
        """Least reversals and least spread of a stem that works like a valve; see `lanes.tells`."""
        searching = self.settings.searching
        return searching.reversals, searching.variance * self.rows.spread

    @cached_property
    def _orders(self) -> Index:
        """Orders of the noise model that may be chosen."""
        return orders_of(self.rows, self.settings.modelling)

    @cached_property
    def _columns(self) -> dict[Hashable, Array]:
        """Columns that were asked for last."""
        return {}

    @cached_property
    def _designs(self) -> dict[Hashable, Design]:
        """Designs that were asked for last."""
        return {}

    def tells(self, stems: Array) -> Mask:
        """Which of the stems ``(n, L)`` work like a valve."""
        found: Mask = tells(stems, *self.works)
        return found

    def columns(
        self, nuisances: tuple[Nuisance, ...], stem: Array, poles: Poles, dead_time: int
    ) -> Array:
        """Everything beside the response, ``(m, n)``."""
        shared = self.rows.columns(integrating=poles.integrating)
        if not nuisances:
            return shared

        def made() -> Array:
            return np.vstack([shared, *columns_of(nuisances, stem, poles, dead_time)])

        if _of_stem(nuisances):
            return made()
        return _kept(self._columns, (nuisances, poles.integrating), made)

    def design(
        self,
        nuisances: tuple[Nuisance, ...],
        taps: Array,
        stem: Array,
        poles: Poles,
        dead_time: int,
    ) -> Design:
        """PV and the columns, whitened; for processes that integrate as ``poles`` do."""

        def made() -> Design:
            return self.design_of(self.columns(nuisances, stem, poles, dead_time), taps)

        if _of_stem(nuisances):
            return made()
        return _kept(self._designs, (nuisances, poles.integrating, taps.tobytes()), made)

    def design_of(self, columns: Array, taps: Array) -> Design:
        """PV and any columns ``(m, n)``, whitened."""
        return Design(self.rows, taps, columns)

    def price(
        self, poles: Poles, nuisances: tuple[Nuisance, ...], taps: Array, valve: bool
    ) -> float:
        """What a hypothesis pays for its parameters, in nats."""
        n = self.rows.count
        # gain, dead time and poles; a straight line where it integrates
        process = 2 + poles.count + int(poles.integrating)
        cost = 0.5 * math.log(n) * (taps.size + process) + price_of(nuisances, n)
        if not valve:
            return cost
        # the law was chosen among several
        laws = math.log(len(self.settings.searching.laws))
        return cost + self.settings.judging.price * math.log(n) + laws

    def log_likelihood(self, squares: float) -> float:
        """Log-likelihood of innovations with this sum of squares, at the likeliest variance."""
        n = self.rows.count
        return -0.5 * n * math.log(max(squares, 0.0) / n + self.rows.floor)

    def worth(self, squares: Array) -> Array:
        """Minus the log-likelihood of each of many sums of squares."""
        n = self.rows.count
        found: Array = 0.5 * n * np.log(np.maximum(squares, 0.0) / n + self.rows.floor)
        return found

    def pole_prices(self, shape: Shape, table: Array) -> Array:
        """What the poles of processes ``(m, 3)`` of one shape cost, in nats, ``(m,)``."""
        found: Array = pole_prices(SHAPE_NUMBERS[shape], table, self.rows.count)
        return found

    def fit(
        self,
        valve: Valve | None,
        poles: Poles,
        dead_time: int,
        nuisances: tuple[Nuisance, ...],
        taps: Array,
        *,
        refit_noise: bool = True,
        stem: Array | None = None,
    ) -> Hypothesis:
        """Fit the linear part, and the noise model to what it leaves, twice in turn."""
        stem = self.stem(valve) if stem is None else stem
        columns = self.columns(nuisances, stem, poles, dead_time)
        orders = self._orders if refit_noise else _NO_ORDERS
        largest = self.settings.modelling.max_reflection
        fit, taps = fit_in_turn(self.rows, stem, poles, dead_time, columns, taps, orders, largest)
        if not self._is_possible(nuisances, stem, poles, fit):
            rest = tuple(one for one in nuisances if not isinstance(one, Characteristic))
            return self.fit(valve, poles, dead_time, rest, taps, refit_noise=refit_noise, stem=stem)
        likelihood = self.log_likelihood(fit.squares) - self.price(
            poles, nuisances, taps, valve is not None
        )
        return Hypothesis(
            valve,
            poles,
            dead_time,
            nuisances,
            taps,
            fit.gains,
            fit.squares,
            fit.residual,
            likelihood,
            stem,
        )

    def _is_possible(
        self, nuisances: tuple[Nuisance, ...], stem: Array, poles: Poles, fit: LinearFit
    ) -> bool:
        """Whether a curved characteristic, where there is one, is that of a valve."""
        place = 3 if poles.integrating else 2
        for one in nuisances:
            if isinstance(one, Characteristic):
                square, cube = (float(v) for v in fit.columns[place : place + 2])
                return one.is_monotonic(stem, float(fit.gains.sum()), square, cube)
            place += 2 * len(one.harmonics) if isinstance(one, Sinusoid) else 1
        return True

    def evidence_of_process(self, hypothesis: Hypothesis) -> float:
        """Log-likelihood ratio of its process over a PV that does not follow OP, in nats.

        The same disturbances and a noise model of its own for both. Nothing is paid for the process
        here: the question is whether its gain differs from zero.
        """
        columns = self.columns(
            hypothesis.outside, hypothesis.stem, hypothesis.poles, hypothesis.dead_time
        )
        nothing = np.zeros(self.rows.size)
        taps = hypothesis.taps
        for _ in range(2):
            fit = fit_linear(self.rows, nothing, 0, columns, taps)
            taps = fit_noise(self.rows, fit.residual, self.settings.modelling)
        fit = fit_linear(self.rows, nothing, 0, columns, taps)
        orders = 0.5 * math.log(self.rows.count) * (taps.size - hypothesis.taps.size)
        gained = self.log_likelihood(hypothesis.squares) - self.log_likelihood(fit.squares)
        return float(gained + orders)


def _of_stem(nuisances: tuple[Nuisance, ...]) -> bool:
    """Whether a nuisance's columns hang on stem and process."""
    return any(isinstance(one, Characteristic) for one in nuisances)


def _kept(kept: dict[Hashable, _Made], key: Hashable, made: Callable[[], _Made]) -> _Made:
    """What is kept under a key, made where it is not; the oldest makes room."""
    found = kept.get(key)
    if found is None:
        if len(kept) >= _KEPT:
            del kept[next(iter(kept))]
        found = kept[key] = made()
    return found
