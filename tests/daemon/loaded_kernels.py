"""What the fork server of the tests imports: a judged window, and so the kernels that it needs.

Every worker has them from its first moment, as one that has rehearsed. Without it each daemon of a
test would load them again, which costs more than all else that the daemon does.
"""

from __future__ import annotations

from estimator import identify
from estimator.warming import rehearsal_windows

__all__ = ["JUDGED"]

JUDGED = identify(*rehearsal_windows()[0])
