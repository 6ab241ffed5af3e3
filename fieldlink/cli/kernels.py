"""Compiles the numeric kernels, and tells whether a process has done so on this machine before."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from compiled import cache_folder

__all__ = ["are_compiled", "compile_kernels"]


def compile_kernels() -> None:
    """Compile every kernel that is not in the cache; load the others.

    Raises:
        OSError: the cache cannot be written.
    """
    import compensator
    import estimator
    import estimator.diagnosis

    estimator.warm_up()
    estimator.diagnosis.warm_up()
    compensator.warm_up()
    _mark().touch()


def are_compiled() -> bool:
    """Whether `compile_kernels` has gone through: the cache then has what a window needs."""
    return _mark().exists()


def _mark() -> Path:
    """The file that says so, beside the kernels: the folder is that of these sources.

    Kernels are of a processor, a Python and a Numba, and so is the file.
    """
    import numba
    from numba.core.registry import cpu_target

    processor = cpu_target.target_context.codegen().magic_tuple()
    made_for = repr((sys.version_info[:2], numba.__version__, processor))
    return cache_folder() / f"complete-{hashlib.sha256(made_for.encode()).hexdigest()[:16]}"
