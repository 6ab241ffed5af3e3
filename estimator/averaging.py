"""Windows that are sampled much faster than the loop moves: judged on averages of a few samples.

Dead time and noise memory are counted in samples. Where a stroke takes hundreds of them, both end
long before the process does, and the samples in between say nothing new. The valve is then found on
block averages, and the process is fitted once more to every sample with that valve.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from estimator.arrays import Array
from estimator.criteria.conversion import describe_process, process_model
from estimator.evidence.weighing import Weighing
from estimator.hypotheses.hypothesis import Case
from estimator.hypotheses.linear_fit import fit_linear
from estimator.hypotheses.noise import WHITE
from estimator.monitoring.indices.wear import travel_and_turns
from estimator.processes.poles import Poles, Shape
from estimator.result import Identification
from estimator.rows import rows_of
from estimator.settings import Screening
from estimator.window import Window
from loop_model import LoopModel

__all__ = ["average", "block_of", "with_every_sample"]


def block_of(op: Array, screening: Screening) -> int:
    """Samples of a block for an OP ``(n,)``; 1 leaves the window as it is.

    The largest block that leaves enough rows, and enough of them in a stroke of OP. A stroke is
    what OP moves one way, turns of less than the least stick band left out: a stem that sticks
    answers noise that is larger, and nothing is averaged then.
    """
    rows, of_a_stroke = screening.enough
    most = op.size // rows
    if most < 2:
        return 1
    _, turns = travel_and_turns(op, screening.min_band * float(np.ptp(op)))
    return int(max(1, min(most, op.size // (of_a_stroke * (1 + turns)))))


def _means(signal: Array, block: int) -> Array:
    """Averages of whole blocks; an incomplete one at the end is left out."""
    count = signal.size // block
    found: Array = signal[: count * block].reshape(count, block).mean(axis=1)
    return found


def average(window: Window, block: int) -> Window:
    """The window in averages, in the same scale; a block is good where half of its samples are."""
    share = _means(window.good.astype(np.float64), block)
    good = share >= 0.5
    sums = _means(window.y * window.good, block)
    return replace(
        window,
        u=_means(window.u, block),
        y=np.where(good, sums / np.maximum(share, 0.5), 0.0),
        good=good,
        period=window.period * block,
    )


def with_every_sample(
    result: Identification, case: Case, window: Window, weighing: Weighing, block: int
) -> Identification:
    """The result on averages with the process, the stem and PV of every sample of the window.

    ``case`` and ``weighing`` are those of the averages, the valve is kept. Gain, offset and dead
    time are fitted again by least squares.
    """
    best = weighing.best
    assert best.valve is not None
    assert result.model is not None
    rows = rows_of(window, case.rows.sign, case.settings.modelling)
    if weighing.varying is None:
        stem = best.valve.stem(window.u)
    else:
        # no law tells where in a block it slips
        stem = np.repeat(best.stem, block)
        stem = np.append(stem, np.full(window.size - stem.size, stem[-1]))
    poles = _finer(best.poles, block)
    response = poles.response(stem)
    columns = rows.columns(integrating=poles.integrating)
    late = range(max(0, (best.dead_time - 1) * block), (best.dead_time + 2) * block + 1)
    fits = [fit_linear(rows, response, d, columns, WHITE) for d in late]
    chosen = int(np.argmin([fit.squares for fit in fits]))
    fit = fits[chosen]
    model = process_model(window, poles, late[chosen], fit, float(stem[0]))
    described = describe_process(window, poles, model, result.process.gain_interval)
    own = {name: described.parameters[name] for name in ("offset", "dead_time")}
    return replace(
        result,
        samples=window.size,
        period_s=window.period,
        process=replace(
            result.process,
            parameters=MappingProxyType({**result.process.parameters, **own}),
            dead_time_samples=described.dead_time_samples,
        ),
        model=LoopModel(result.model.valve, model),
        stem=window.op_centre + window.op_span * stem,
        pv_model=window.pv_centre + window.pv_scale * (rows.y - fit.residual),
        identifiability=(
            *result.identifiability,
            f"the window is sampled faster than the loop moves: the valve was identified on "
            f"averages of {block} samples",
        ),
    )


def _finer(poles: Poles, block: int) -> Poles:
    """The same process in samples that are shorter by a factor."""
    damped = poles.shape is Shape.SWINGING
    return replace(
        poles,
        slow=poles.slow * block,
        fast=poles.fast if damped else poles.fast * block,
        third=poles.third * block,
    )
