"""The plants that come with fieldlink: what each is, and where its FMU stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from loop_model import ProcessModel, ValveModel

from .build import build, is_current, target_file
from .describe import FmiVersion
from .errors import PlantNameError, nearest

__all__ = ["CatalogueModel", "catalogue", "fmu_path"]


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
    """

    name: str
    description: str
    process: ProcessModel | None
    op_range: tuple[float, float]
    period: float
    valve: ValveModel
    noise_std: float


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

catalogue: Mapping[str, CatalogueModel] = MappingProxyType(
    {model.name: model for model in (_EXAMPLE1, _EXAMPLE2)}
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
