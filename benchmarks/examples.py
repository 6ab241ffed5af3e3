"""Closed-loop windows of the paper's Examples 1 and 2.

The plants are the continuous processes sampled exactly (zero-order hold at 1 s), by SciPy. The
paper prints their coefficients rounded to four digits, (15) and (18), which shifts the gain of a
process with poles so near to 1: rounded, Example 1 has gain 1.012 and Example 2 has 0.948, where
the exact ones have 1. The paper does not print Example 2's transfer function; the one here is the
only one with round time constants whose coefficients round to (18).

The loop is closed by the paper's stiction-unaware MPC (16) on the exact linear model, noise enters
as ``v`` of (7), and a window begins somewhere in a cycle after the oscillation has settled. The
paper generates its data "imposing some set-point changes": so do these windows, two of them. The
same loop at constant set-point is the harder case: one move of the stem a stroke, always alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from compensator.conventional.unaware import UnawareMpc
from fieldlink.lab.study.closed_loop import Study, run
from loop_model import ProcessModel, ValveModel

__all__ = ["EXAMPLES", "Example", "ExampleWindow", "PublishedFit", "example_window", "sampled"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PublishedFit:
    """What the paper reports: frictions, theta as ``[a, b]`` of (8), seconds."""

    static_friction: float
    dynamic_friction: float
    theta: tuple[float, ...]
    seconds: float
    grid_seconds: float | None

    @property
    def gain(self) -> float:
        """Gain of the published theta, ``B(1)/A(1)``."""
        half = len(self.theta) // 2
        return sum(self.theta[half:]) / (1.0 + sum(self.theta[:half]))


@dataclass(frozen=True, slots=True)
class Example:
    """One of the paper's examples: truth, printed coefficients, noise, published result."""

    name: str
    valve: ValveModel
    process: ProcessModel
    printed: ProcessModel
    noise: float
    published: PublishedFit


@dataclass(frozen=True, slots=True)
class ExampleWindow:
    """A window of an example: OP, PV and the stem, which no plant measures, shape ``(n,)``."""

    op: Array
    pv: Array
    stem: Array


def sampled(*time_constants: float, gain: float = 1.0, period: float = 1.0) -> ProcessModel:
    """``gain / prod(T s + 1)`` sampled with a zero-order hold, as ARX without delay.

    To ten digits: the last ones are the processor's, and a loop that cycles makes much of them.
    """
    denominator = np.poly([-1.0 / t for t in time_constants]) * np.prod(time_constants)
    continuous = (np.array([gain]), np.asarray(denominator, dtype=np.float64))
    num, den = signal.cont2discrete(continuous, period, method="zoh")[:2]
    b = np.asarray(num, dtype=np.float64).ravel()
    # A strictly proper process has no feed-through; its first numerator coefficient is 0.
    return ProcessModel(
        a=tuple(float(f"{v:.10g}") for v in np.asarray(den)[1:]),
        b=tuple(float(f"{v:.10g}") for v in b[1:]),
        dead_time=1,
        offset=0.0,
        period=period,
    )


EXAMPLES = (
    Example(
        name="Example 1",
        valve=ValveModel.from_friction(7.0, 4.0),
        process=sampled(4.0, 6.0, 2.0),
        printed=ProcessModel((-2.232, 1.645, -0.3998), (0.00277, 0.00884, 0.001752), 1, 0.0, 1.0),
        noise=1e-2,
        published=PublishedFit(
            6.98, 4.01, (-1.195, -0.204, 0.4353, 0.00375, 0.01094, 0.01767), 4.0, 150.0
        ),
    ),
    Example(
        name="Example 2",
        valve=ValveModel.from_friction(5.0, 2.0),
        process=sampled(10.0, 5.0, 1.0),
        printed=ProcessModel((-2.091, 1.375, -0.2725), (0.002445, 0.007181, 0.001278), 1, 0.0, 1.0),
        noise=10.0**-1.5,
        published=PublishedFit(
            5.02, 1.99, (-1.124, -0.360, 0.5112, 0.002085, 0.011218, 0.010629), 6.0, None
        ),
    ),
)


def example_window(
    example: Example, seed: int, *, samples: int = 1000, constant: bool = False
) -> ExampleWindow:
    """A window of ``samples`` that begins in mid-cycle.

    The loop starts at rest at OP 50, the set-point steps to 55 after 50 samples, and the window
    begins at a sample drawn from 500 to 600. Three tenths into the window the set-point steps to
    48, and seven tenths to 53, or it stays where it is (``constant``). The same seed gives the same
    window.
    """
    begin = 500 + int(np.random.default_rng([seed, 1]).integers(0, 100))
    changes = (
        () if constant else ((begin + 3 * samples // 10, 48.0), (begin + 7 * samples // 10, 53.0))
    )
    study = Study(
        setpoint=((0, 50.0), (50, 55.0), *changes),
        samples=begin + samples,
        equation_noise=example.noise,
        seed=seed,
    )
    trace = run(example.process, example.valve, UnawareMpc(example.process), study)
    part = slice(begin, begin + samples)
    return ExampleWindow(trace.op[part], trace.pv[part], trace.stem[part])
