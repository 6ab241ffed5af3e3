"""Outputs between the ends of a step, where a co-simulation FMU of FMI 3 offers them.

Such an FMU calls back after each step of its own solver (FMI 3.0, 4.2.1.1). Inputs keep their
values during a step, and no early return is asked for: what is taken is the course of the outputs.
"""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException

from .errors import PlantStepError
from .plant import Piece
from .variables import VariableAccess

__all__ = ["IntermediateLog"]


class IntermediateLog:
    """Collects rows of outputs while an FMU steps.

    Args:
        variables: of the FMU; its outputs and what is watched are the columns.
        names: of the columns.
    """

    def __init__(self, variables: VariableAccess, names: tuple[str, ...]) -> None:
        self.fmu: Any = None
        """FMPy's object, known only after the FMU has got the callback."""
        self._variables = variables
        self._names = names
        self._moments = array("d")
        self._values = array("d")
        self._row = np.empty(len(names))
        self._failure: str | None = None

    def listen(
        self,
        _environment: Any,
        time: float,
        _set_requested: bool,
        get_allowed: bool,
        step_finished: bool,
        _can_return: bool,
        return_requested: Any,
        _return_time: Any,
    ) -> None:
        """Take the outputs in; this is the callback of FMI 3."""
        if return_requested:
            return_requested[0] = False
        if not (get_allowed and step_finished) or self.fmu is None:
            return
        try:
            self._variables.read_row(self.fmu, self._row)
        except FMICallException as error:  # nothing can be raised through the FMU's code
            self._failure = self._failure or f"at {time:g} s: {error}"
            return
        self._moments.append(time)
        self._values.extend(self._row)

    def take(self) -> Piece:
        """Return the rows since this was called last.

        Raises:
            PlantStepError: the FMU offered values and refused to give them.
        """
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise PlantStepError(f"the outputs between two steps could not be read {failure}")
        moments = np.array(self._moments)
        table = np.array(self._values).reshape(-1, len(self._names))
        del self._moments[:], self._values[:]
        return Piece(moments, {name: table[:, i].copy() for i, name in enumerate(self._names)})
