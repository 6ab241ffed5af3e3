"""The processes that explain a window about as well as the likeliest one.

A prediction has to hold for all of them. In closed loop a record says little of the process away
from the frequencies at which its loop moves, and a noise model that is too short makes it say what
is not so. Therefore the process is fitted once more beside a long noise model; every dead time and
shape that is about as likely is kept; and around each the time constants and gains are spread as
widely as the record leaves them, the noise model free. What this does not know (a plant that is not
quite linear, or changes) shows where the halves of the record tell different processes.

Source: Ljung (1999), System Identification: (9.17) for the covariance, 13.4 for closed loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.criteria.conversion import process_model
from estimator.diagnosis.advice_settings import Advising
from estimator.diagnosis.long_noise import with_long_noise
from estimator.hypotheses.gain import NUDGE, pole_derivatives
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import LinearFit, delay, fit_linear
from estimator.processes.poles import STARTS, Poles, Shape, coefficients
from estimator.search.processes import (
    POLE_LANES,
    POLE_NARROWER,
    POLE_REACH,
    POLE_ROUNDS,
    polish,
    settle,
    spread_points,
)
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["FittedWindow", "PlausibleProcesses", "find_plausible"]

_LEAST = 6
"""Samples of the least likely mode that counts."""
_TURNED = 0.05
"""Share of its gain that a sample keeps whose gain would change its sign."""


@dataclass(frozen=True, slots=True)
class FittedWindow:
    """The explanation of a window with the rows on which it was fitted.

    ``late`` is the number of samples by which OP was moved before the fit.
    """

    case: Case
    window: Window
    fit: Hypothesis
    late: int


@dataclass(frozen=True, slots=True)
class PlausibleProcesses:
    """Processes with the share of the probability that each stands for; the shares sum to one.

    ``likeliest`` is the first; ``evidence`` is that of it over a PV that does not follow OP, nats.
    ``halves`` are the processes of the record's first and last half, where the half shows one.
    """

    likeliest: ProcessModel
    processes: tuple[ProcessModel, ...]
    shares: Array
    evidence: float
    halves: tuple[ProcessModel, ...]


def find_plausible(of: FittedWindow, settings: Advising) -> PlausibleProcesses:
    """The plausible processes of a window, in units of OP and PV."""
    case = with_long_noise(of.case, settings)
    fit = of.fit
    fit = settle(case, polish(case, fit.valve, fit, fit.nuisances, fit.taps, passes=3, wide=True))
    modes = _modes(case, fit, settings)
    best = max(modes, key=lambda one: one.likelihood)
    weights = np.exp([one.likelihood - best.likelihood for one in modes])
    weights /= weights.sum()
    processes: list[ProcessModel] = []
    shares: list[float] = []
    for mode, weight in zip(modes, weights, strict=True):
        count = max(_LEAST, round(settings.samples * float(weight)))
        processes += [
            _model(of, poles, mode, part) for poles, part in _spread(case, mode, count, settings)
        ]
        shares += [float(weight) / count] * count
    return PlausibleProcesses(
        likeliest=_model(of, best.poles, best, _linear_part(case, best)),
        processes=tuple(processes),
        shares=np.array(shares),
        evidence=float(case.evidence_of_process(best)),
        halves=tuple(
            _model(of, mode.poles, mode, _linear_part(half, mode))
            for half, mode in _halves(case, best)
        ),
    )


def _halves(case: Case, whole: Hypothesis) -> list[tuple[Case, Hypothesis]]:
    """Each half of the rows that shows a process, with the likeliest one."""
    rows = case.rows
    middle = (rows.first + rows.size) // 2
    found = []
    for part in (slice(0, middle), slice(middle, rows.size)):
        weight = np.zeros(rows.size)
        weight[part] = rows.weight[part]
        half = replace(case, rows=replace(rows, weight=weight, count=float(weight.sum())))
        mode = settle(half, polish(half, whole.valve, whole, whole.nuisances, whole.taps))
        if half.evidence_of_process(mode) >= case.settings.judging.threshold:
            found.append((half, mode))
    return found


def _model(of: FittedWindow, poles: Poles, mode: Hypothesis, part: LinearFit) -> ProcessModel:
    found = process_model(of.window, poles, mode.dead_time, part, 0.0)
    return replace(found, dead_time=found.dead_time + of.late)


def _linear_part(case: Case, fit: Hypothesis) -> LinearFit:
    columns = case.columns(fit.nuisances, fit.stem, fit.poles, fit.dead_time)
    response = fit.poles.response(fit.stem)
    return fit_linear(case.rows, response, fit.dead_time, columns, fit.taps)


def _modes(case: Case, fit: Hypothesis, settings: Advising) -> list[Hypothesis]:
    """The process of every dead time and shape that is about as likely as the likeliest."""
    found = [fit]
    seen = {(fit.poles.shape, fit.dead_time)}
    screened = _screen(case, fit)
    for worth, start, dead_time in screened:
        if worth > screened[0][0] + settings.screen or len(found) >= settings.modes:
            break
        if (start.shape, dead_time) in seen:
            continue
        seen.add((start.shape, dead_time))
        poles, one = start, fit
        for _ in range(2):
            poles = _refine(case, fit, poles, dead_time, one.taps)
            one = case.fit(fit.valve, poles, dead_time, fit.nuisances, one.taps, stem=fit.stem)
        found.append(one)
    top = max(one.likelihood for one in found)
    return [one for one in found if one.likelihood > top - settings.behind]


def _screen(case: Case, fit: Hypothesis) -> list[tuple[float, Poles, int]]:
    """Cost in nats, poles and dead time of the best start for every shape and dead time."""
    found = []
    for shape in Shape:
        group = [one for one in (fit.poles, *STARTS) if one.shape is shape]
        table = np.array([[one.slow, one.fast, one.third] for one in group])
        like = replace(fit.poles, shape=shape)
        design = case.design(fit.nuisances, fit.taps, fit.stem, like, fit.dead_time)
        costs = design.through(fit.stem, coefficients(shape, table), 0, case.max_dead_time + 1)
        worth = case.worth(costs) + case.pole_prices(shape, table)
        for late in range(worth.shape[0]):
            lane = int(worth[late].argmin())
            found.append((float(worth[late, lane]), group[lane], late))
    return sorted(found, key=lambda one: one[0])


def _refine(case: Case, fit: Hypothesis, poles: Poles, dead_time: int, taps: Array) -> Poles:
    """Poles of the least cost at one dead time, the noise model held."""
    design = case.design(fit.nuisances, taps, fit.stem, poles, dead_time)
    points = spread_points(POLE_LANES, 3)
    reach, best = POLE_REACH, math.inf
    for _ in range(POLE_ROUNDS):
        table = poles.moved(reach * points)
        if poles.shape is Shape.LAGS and poles.fast == 0.0 and poles.slow > 0.0:
            # a second lag of any size where there was none
            table[-8:, 1] = np.maximum(0.15, np.linspace(0.05, 1.0, 8) * poles.slow)
        elif poles.integrating and poles.fast == 0.0:
            table[-4:, 1] = 0.3, 1.0, 3.0, 8.0
        costs = design.through(fit.stem, coefficients(poles.shape, table), dead_time, 1)
        worth = (case.worth(costs) + case.pole_prices(poles.shape, table))[0]
        lane = int(worth.argmin())
        if worth[lane] < best - 1e-6:
            best, poles = float(worth[lane]), poles.of_row(table[lane])
        reach *= POLE_NARROWER
    return poles


def _spread(
    case: Case, mode: Hypothesis, count: int, settings: Advising
) -> list[tuple[Poles, LinearFit]]:
    """``count`` processes spread as the covariance of poles and gains says, the likeliest first."""
    names = [
        name
        for name in ("slow", "fast", "third")
        if getattr(mode.poles, name) > 0.0 and not (mode.poles.integrating and name == "slow")
    ]
    used = [i for i in range(2) if mode.gains[i] != 0.0]
    part = _linear_part(case, mode)
    if not used:
        return [(mode.poles, part)] * count
    covariance = _covariance(case, mode, used)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    found = []
    for point in spread_points(count, covariance.shape[0]):
        step = root @ point
        gains = mode.gains.copy()
        gains[used] += step[: len(used)]
        if gains.sum() * mode.gains.sum() <= 0.0:
            gains = mode.gains * _TURNED
        moved = {
            name: getattr(mode.poles, name)
            * math.exp(float(np.clip(change, -settings.reach, settings.reach)))
            for name, change in zip(names, step[len(used) :], strict=True)
        }
        if mode.poles.shape is Shape.SWINGING:
            moved["fast"] = min(moved["fast"], 0.98)
        found.append((replace(mode.poles, **moved), replace(part, gains=gains)))
    return found


def _covariance(case: Case, mode: Hypothesis, used: list[int]) -> Array:
    """Of the gains used and the logarithms of the time constants, noise model and columns free."""
    rows = case.rows
    own = mode.poles.response(mode.stem)
    responses = np.stack([delay(own, mode.dead_time + i) for i in used])
    slopes = [
        (mode.gains[0] * one + mode.gains[1] * delay(one, 1)) / NUDGE
        for one in pole_derivatives(mode)
    ]
    columns = case.columns(mode.nuisances, mode.stem, mode.poles, mode.dead_time)
    design = np.vstack([responses, *(one[None] for one in slopes), columns])
    white = filter_rows(design, mode.taps, rows.weight)
    # the innovations change with each tap as the residual so many samples before
    past = [delay(mode.residual, i + 1) * rows.weight for i in range(mode.taps.size)]
    full = np.vstack([white, *(one[None] for one in past)])
    scale = np.sqrt(np.sum(full**2, axis=1)) + 1e-300
    scaled = full / scale[:, None]
    spread = np.linalg.pinv(scaled @ scaled.T, rcond=1e-10, hermitian=True)
    variance = mode.squares / max(1.0, rows.count - full.shape[0]) + rows.floor
    k = len(used) + len(slopes)
    found = variance * spread[:k, :k] / np.outer(scale[:k], scale[:k])
    return np.asarray(0.5 * (found + found.T))
