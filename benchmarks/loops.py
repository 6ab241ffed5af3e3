"""Random loops with a known valve, drawn from a name, for tests of the estimator.

A loop is drawn from its name alone (``s17`` is sticky, ``h17`` healthy): plant, controller,
sampling, valve, noise and disturbances. Gains are about one PV unit per percent of OP, or sizes are
scaled by the gain, so that percent of OP is a measure for everything.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

__all__ = ["FMU_PLANTS", "SIMULATED", "Loop", "draw_loop", "named_loop"]

SIMULATED = ("first order", "second order", "dead time", "integrating")
"""Linear processes, simulated from their coefficients."""

FMU_PLANTS = ("flow", "pressure", "heat", "level", "physical")
"""Plants of the catalogue: square-root valve, gas vessel, exchanger, tank, pneumatic actuator."""

NOISES = ("white", "drift", "load steps")

_LAW_VALVES = ("He", "Kano", "Choudhury")
_FRICTION = ("Karnopp", "LuGre")


@dataclass(frozen=True, slots=True)
class Loop:
    """A loop with everything that was drawn for it.

    Attributes:
        seed: of the draw and of all noise.
        plant: one of `SIMULATED` or `FMU_PLANTS`.
        controller: ``"PI"`` or ``"MPC"``.
        physics: valve model, or ``"healthy"``; Karnopp and LuGre are the catalogue's pneumatic
            actuator with that friction, in front of whatever plant.
        noise_kind: one of `NOISES`; white noise is always there.
        stick_band, slip_jump: in percent of OP; both 0 is a healthy valve.
        noise: standard deviation of PV's white noise as a share of that of PV's own cycle (of 0.5 %
            of OP when healthy).
        disturbance: size of the load's changes as a share of the stick band (of 2 % of OP when
            that is more).
        sampling: period over the plant's time constant.
        dead_time: samples beyond the one of sampling.
        aggressive: factor on the PI controller's gain.
        trouble: what a healthy loop may oscillate from: ``"none"``, ``"outside"`` (a sinusoidal
            load) or ``"tuning"`` (a PI gain at the edge of stability).
    """

    seed: int
    plant: str
    controller: str
    physics: str
    noise_kind: str
    stick_band: float
    slip_jump: float
    noise: float
    disturbance: float
    sampling: float
    dead_time: int
    aggressive: float
    trouble: str

    @property
    def name(self) -> str:
        """``s17`` or ``h17``: what `named_loop` takes."""
        return f"{'h' if self.is_healthy else 's'}{self.seed}"

    @property
    def is_healthy(self) -> bool:
        """Whether there is nothing to find."""
        return self.stick_band == 0.0

    @property
    def is_moderate(self) -> bool:
        """Noise that a technician would call moderate: white, at most 15 % of the cycle."""
        return self.noise <= 0.15 and self.noise_kind == "white"

    @property
    def time_constant(self) -> float:
        """Of the plant, in samples."""
        return 1.0 / self.sampling


def draw_loop(seed: int, *, healthy: bool) -> Loop:
    """The loop of a seed."""
    rng = np.random.default_rng([seed, int(healthy)])
    plants = (*SIMULATED, *FMU_PLANTS)
    # Half of the loops have one of the simulated processes, half one of the FMUs.
    share = [0.5 / len(SIMULATED)] * len(SIMULATED) + [0.5 / len(FMU_PLANTS)] * len(FMU_PLANTS)
    plant = str(rng.choice(plants, p=share))
    stick_band = float(np.exp(rng.uniform(np.log(0.5), np.log(10.0))))
    slip_jump = stick_band * float(rng.uniform(0.05, 1.0))
    sampling = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
    controller = str(rng.choice(["PI", "PI", "MPC"]))
    laws = _LAW_VALVES if plant in FMU_PLANTS else (*_LAW_VALVES, *_FRICTION)
    physics = str(rng.choice(_FRICTION if plant == "physical" else laws))
    loop = Loop(
        seed=seed,
        plant=plant,
        # Nobody gives the MPC a linear model of the nonlinear plants.
        controller="PI" if plant in FMU_PLANTS else controller,
        physics=physics,
        noise_kind=str(rng.choice(NOISES, p=[0.6, 0.2, 0.2])),
        stick_band=stick_band,
        slip_jump=slip_jump,
        noise=float(rng.uniform(0.02, 0.3)),
        disturbance=float(rng.uniform(0.05, 0.4)),
        sampling=sampling,
        dead_time=max(1, round(rng.uniform(0.3, 1.5) / sampling)) if plant == "dead time" else 0,
        aggressive=float(rng.uniform(0.7, 1.5)),
        trouble=str(rng.choice(["none", "outside", "tuning"])),
    )
    if plant == "heat":
        loop = replace(loop, dead_time=round(loop.time_constant / 3.0))
    if healthy and loop.trouble == "tuning":
        loop = replace(loop, controller="PI")
    if healthy:
        return replace(loop, stick_band=0.0, slip_jump=0.0, physics="healthy")
    return replace(loop, trouble="none")


def named_loop(name: str) -> Loop:
    """The loop called ``s17`` (sticky) or ``h17`` (healthy).

    Raises:
        ValueError: another name.
    """
    if name[:1] not in ("s", "h") or not name[1:].isdecimal():
        raise ValueError(f"{name!r} is not a loop: name a sticky one s17, a healthy one h17")
    return draw_loop(int(name[1:]), healthy=name[0] == "h")
