"""Load or compile the kernels of a diagnosis ahead of the first one."""

from __future__ import annotations

from estimator.diagnosis.diagnose import diagnose
from estimator.warming import rehearsal_windows

__all__ = ["warm_up"]


def warm_up() -> None:
    """Load or compile the kernels, so that the first diagnosis does not wait for them."""
    for op, pv in rehearsal_windows():
        diagnose(op, pv)
