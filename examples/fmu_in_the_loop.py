"""Put an FMU behind a controller of your own, and identify the valve from what it shows.

    python examples/fmu_in_the_loop.py [PLANT]

PLANT is a plant of the catalogue or an .fmu file with an input op and an output pv.
"""

from __future__ import annotations

import sys

import numpy as np

from compensator import PiController, PiSettings
from estimator import Identification, identify
from fmu_models import catalogue, open_plant

STEPS = (1.1, 1.05, 1.12, 1.03, 1.08)
"""Set-points over the first one: without noise the valve moves only when it is asked to."""


def main(name: str = "flow", samples: int = 900) -> Identification:
    """Run the plant under PI with five set-point steps; print and return the verdict."""
    process = catalogue[name].process if name in catalogue else None
    settings = PiSettings(gain=0.35, integral_time=3.0)
    controller = PiController(PiSettings.simc(process) if process else settings)
    op, pv, sp = np.full(samples, 40.0), np.empty(samples), np.empty(samples)
    with open_plant(name, parameters={"op_start": 40.0}) as plant:
        start = plant.outputs()["pv"]
        for k in range(samples):
            pv[k] = plant.outputs()["pv"]
            sp[k] = start * (1.0 if k < 50 else STEPS[5 * k // samples])
            controller.observe(float(pv[k]), float(op[k - 1]))
            op[k] = controller.decide(float(sp[k])).op
            plant.step({"op": float(op[k])})
        period = plant.info.period
    found = identify(op, pv, sp=sp, period=period)
    print(f"{name}: {found.verdict.value}, S {found.stick_band.value:.2f}, score {found.score:.0f}")
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
