"""The plants that come with fieldlink: what each is, and where its FMU stands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from loop_model import ProcessModel, ValveModel

from .describe import FmiVersion
from .errors import PlantNameError, nearest
from .packing import build, is_current, target_file

__all__ = ["CatalogueModel", "LoopVariables", "catalogue", "fmu_path", "plant_file"]


@dataclass(frozen=True, slots=True)
class LoopVariables:
    """What the variables of one loop of a plant are called."""

    op: str = "op"
    pv: str = "pv"
    sp: str = "sp"
    stem: str = "stem"
    op_out: str = "op_out"
    load: str = "load"
    valve: str = "valve"
    stick_band: str = "stick_band"
    slip_jump: str = "slip_jump"
    controller: str = "controller"
    pi_gain: str = "pi_gain"
    pi_time: str = "pi_time"

    @classmethod
    def numbered(cls, number: int) -> LoopVariables:
        """Return the names of loop ``number`` of a plant with several: ``op1``, ``op1_out``."""
        names = {name: f"{name}{number}" for name in cls.__slots__}
        return cls(**(names | {"op_out": f"op{number}_out"}))


@dataclass(frozen=True, slots=True)
class CatalogueModel:
    """A plant of the catalogue.

    Attributes:
        name: what `fmu_path` and `open_plant` call it.
        description: one sentence.
        process: the linear process behind the valve, PV from stem at ``period``, with the model's
            default parameters; None where the plant is not linear.
        op_range: the range of OP that makes sense, in percent.
        period: the sampling period in seconds that it is meant for.
        valve: stick band and slip jump by default, in percent of OP.
        noise_std: default of the parameter ``noise_std``.
        loops: the names of its variables, loop by loop; all but one plant have one loop.
    """

    name: str
    description: str
    process: ProcessModel | None
    op_range: tuple[float, float]
    period: float
    valve: ValveModel
    noise_std: float
    loops: tuple[LoopVariables, ...] = (LoopVariables(),)


def _two_lags(
    *, gain: float, lags: tuple[float, float], dead_time: float, base: float, period: float
) -> ProcessModel:
    """Sample ``gain / ((t1 s + 1)(t2 s + 1)) exp(-dead_time s)`` with a zero-order hold."""
    p1, p2 = (math.exp(-period / lag) for lag in lags)
    share = lags[0] / (lags[0] - lags[1])
    # The step response is gain (1 - share p1^k - (1 - share) p2^k); b follows from its first two.
    first, second = (gain * (1.0 - share * p1**k - (1.0 - share) * p2**k) for k in (1, 2))
    a1, a2 = -(p1 + p2), p1 * p2
    return ProcessModel(
        a=(a1, a2),
        b=(first, second - first + a1 * first),
        dead_time=1 + round(dead_time / period),
        offset=base * (1.0 + a1 + a2),
        period=period,
    )


_EXAMPLE1 = CatalogueModel(
    name="example1",
    description="Example 1 of the smoothed-stiction paper: 1/((4s+1)(6s+1)(2s+1)), He's valve",
    # (14) sampled exactly; the printed coefficients of (15) are these, rounded.
    process=ProcessModel(
        a=(-2.231813167674652366, 1.645024301974050480, -0.399849654344847355),
        b=(0.00277004042153942798, 0.00883976757343873863, 0.00175167195957259297),
        dead_time=1,
        offset=0.0,
        period=1.0,
    ),
    op_range=(0.0, 100.0),
    period=1.0,
    valve=ValveModel.from_friction(7.0, 4.0),
    noise_std=0.01,
)
_EXAMPLE2 = CatalogueModel(
    name="example2",
    description="Example 2 of the smoothed-stiction paper: 1/((10s+1)(5s+1)(s+1)), He's valve",
    # (18) prints these, rounded.
    process=ProcessModel(
        a=(-2.091447612285383753, 1.374883516291999516, -0.272531793034012603),
        b=(0.00244475012391598515, 0.00718125368146906354, 0.00127810716721811076),
        dead_time=1,
        offset=0.0,
        period=1.0,
    ),
    op_range=(0.0, 100.0),
    period=1.0,
    valve=ValveModel.from_friction(5.0, 2.0),
    noise_std=10.0**-1.5,
)
_FLOW = CatalogueModel(
    name="flow",
    description="flow through a valve in a line: fast, noisy, the gain falls as the valve opens",
    process=None,
    op_range=(5.0, 100.0),
    period=1.0,
    valve=ValveModel(stick_band=4.0, slip_jump=1.0),
    noise_std=0.3,
)
_LEVEL = CatalogueModel(
    name="level",
    description="level of a tank with a constant outflow: integrating, full in 200 s",
    # The outflow balances the inflow at OP 50.
    process=ProcessModel(a=(-1.0,), b=(1 / 200,), dead_time=1, offset=-50 / 200, period=1.0),
    op_range=(0.0, 100.0),
    period=1.0,
    valve=ValveModel(stick_band=5.0, slip_jump=1.5),
    noise_std=0.05,
)
_HEAT = CatalogueModel(
    name="heat",
    description="outlet temperature of a heat exchanger: slow, dead time 20 s, lags 60 s and 15 s",
    process=_two_lags(gain=0.8, lags=(60.0, 15.0), dead_time=20.0, base=20.0, period=5.0),
    op_range=(0.0, 100.0),
    period=5.0,
    valve=ValveModel(stick_band=3.0, slip_jump=1.0),
    noise_std=0.05,
)
_PRESSURE = CatalogueModel(
    name="pressure",
    description="pressure of a gas vessel between header and consumers: nonlinear",
    process=None,
    op_range=(5.0, 100.0),
    period=1.0,
    valve=ValveModel(stick_band=4.0, slip_jump=1.0),
    noise_std=0.005,
)
_PHYSICAL = CatalogueModel(
    name="physical",
    description="pneumatic actuator, stem and packing with Karnopp or LuGre friction, lag of 5 s",
    # Of a stem that moves at the samples only; this one takes a part of a second.
    process=ProcessModel(
        a=(-math.exp(-0.2),), b=(-math.expm1(-0.2),), dead_time=1, offset=0.0, period=1.0
    ),
    op_range=(0.0, 100.0),
    period=1.0,
    valve=ValveModel(stick_band=8.0, slip_jump=2.0),
    noise_std=0.05,
)
_PH = CatalogueModel(
    name="ph",
    description="pH of a neutralisation tank: the gain changes manyfold with the operating point",
    process=None,
    op_range=(0.0, 100.0),
    period=5.0,
    valve=ValveModel(stick_band=3.0, slip_jump=1.0),
    noise_std=0.02,
)
_FOURTANK = CatalogueModel(
    name="fourtank",
    description="four tanks and two sticky valves (Johansson, 2000): two loops that interact",
    process=None,
    op_range=(0.0, 100.0),
    period=1.0,
    valve=ValveModel(stick_band=4.0, slip_jump=1.0),
    noise_std=0.02,
    loops=(LoopVariables.numbered(1), LoopVariables.numbered(2)),
)

catalogue: Mapping[str, CatalogueModel] = MappingProxyType(
    {
        model.name: model
        for model in (
            *(_EXAMPLE1, _EXAMPLE2, _FLOW, _LEVEL, _HEAT, _PRESSURE),
            *(_PHYSICAL, _PH, _FOURTANK),
        )
    }
)
"""Every plant that comes with fieldlink, by name."""


def fmu_path(name: str, version: FmiVersion = 3) -> Path:
    """Return a ready ``.fmu`` of a plant of the catalogue; it is built first where it is stale.

    Args:
        name: a key of `catalogue`.
        version: of FMI, 2 or 3.

    Raises:
        PlantNameError: there is no such plant.
        PlantBuildError: it had to be built and could not be.
    """
    if name not in catalogue:
        raise PlantNameError(f"the catalogue has no plant {name!r}; {nearest(name, catalogue)}")
    file = target_file(name, version)
    if not is_current(file, name, version):
        build(name)
    return file


def plant_file(model: str | Path) -> Path:
    """Return the file of a plant: a name of the catalogue, or a path.

    Args:
        model: a string that ends in ``.fmu`` or ``.ssp`` is a path, any other a name.

    Raises:
        PlantNameError: there is no such plant.
        PlantBuildError: it had to be built and could not be.
    """
    if isinstance(model, Path) or model.endswith((".fmu", ".ssp")):
        return Path(model)
    if model not in catalogue:
        raise PlantNameError(
            f"the catalogue has no plant {model!r}; {nearest(model, catalogue)}; the path of an "
            "FMU ends in .fmu"
        )
    return fmu_path(model)
