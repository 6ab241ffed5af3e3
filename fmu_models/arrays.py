"""Arrays of FMI 3: their sizes, fixed or decided by structural parameters, and their elements."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from .errors import PlantInputError

__all__ = ["MAX_ELEMENTS", "element_names", "resolve_shape"]

MAX_ELEMENTS = 1_000_000
"""Of one array; more columns than that fit no table, and a wrong size would fill the memory."""


def element_names(name: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of an array's elements in FMI's order: the last index runs fastest."""
    indices = itertools.product(*(range(1, size + 1) for size in shape))
    return tuple(f"{name}[{','.join(map(str, index))}]" for index in indices)


def resolve_shape(variable: Any, structural: Mapping[str, float]) -> tuple[int, ...]:
    """Return the sizes of a variable's dimensions, ``()`` for a scalar.

    Args:
        variable: FMPy's.
        structural: values of structural parameters that are not their start values.

    Raises:
        PlantInputError: a size that is negative or no whole number, or too many elements.
    """
    shape: list[int] = []
    total = 1
    for dimension in variable.dimensions or ():
        source = dimension.variable
        size = float(dimension.start or 0) if source is None else float(source.start or 0)
        if source is not None:
            size = float(structural.get(source.name, size))
        if not (size >= 0.0 and size.is_integer()):
            raise PlantInputError(
                f"{variable.name}: its size is {source.name if source else 'given'} = {size:g}; "
                "it must be a whole number, 0 or more"
            )
        shape.append(int(size))
        total *= int(size)
    if total > MAX_ELEMENTS:
        raise PlantInputError(
            f"{variable.name}: it would have {total} elements; the limit is {MAX_ELEMENTS}"
        )
    return tuple(shape)
