"""How the numeric kernels of `estimator` and `compensator` are compiled, and where they are kept.

Three rules make a result the same on every processor:

* Strict arithmetic. Without ``fastmath`` the compiler may neither reorder a sum nor fuse a product
  into it, so that a loop gives the same bits whatever the width of the processor's lanes. Kernels
  are quick because many candidates are worked on side by side, one a lane.
  The compiler does not know that two rows of an array are apart: it checks at every pass, which
  for a few lanes costs more than the pass. What is `innermost` spares it that.
* One process at a time in the cache. Numba reads a function's index, adds a name and writes it back
  without a lock (numba issue 4807): of two processes that compile at once, one could load what the
  other had compiled for other types or another processor. And one process compiles a function;
  those that need it at the same time (the workers of a pool) wait for it and load it.
* One cache for one state of the sources. Numba compiles a kernel again when its own file changes,
  but not when a kernel that it calls changes in another file. The cache folder's name therefore
  holds a hash of all kernel sources: after an upgrade no old kernel can run.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import config
from numba.core.caching import IndexDataCacheFile
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

__all__ = ["cache_folder", "innermost", "kernel", "kernel_for", "source_hash"]

_PACKAGES = ("estimator", "compensator", "benchmarks/families")
_HASH_DIGITS = 16

_Function = TypeVar("_Function", bound=Callable[..., Any])


def source_hash(root: Path) -> str:
    """Hash of every Python source below ``root`` that may hold a kernel, and of this file."""
    digest = hashlib.sha256()
    files = [p for package in _PACKAGES for p in sorted((root / package).rglob("*.py"))]
    for path in [*files, root / "compiled.py"]:
        if path.is_file():
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:_HASH_DIGITS]


@cache
def cache_folder() -> Path:
    """The folder of the compiled kernels: its name changes with every change of a kernel source.

    Beside this file; where that cannot be written (a system-wide installation), in the user's
    cache; ``NUMBA_CACHE_DIR`` goes before both.
    """
    root = Path(__file__).resolve().parent
    name = f"fieldlink-kernels-{source_hash(root)}"
    given = os.environ.get("NUMBA_CACHE_DIR")
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    places = [Path(given)] if given else [root / "__pycache__", user / "fieldlink"]
    for place in places:
        folder = place / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix=name))


def kernel(function: _Function) -> _Function:
    """Compile a loop with strict arithmetic; division by zero gives infinity or NaN as in NumPy."""
    return _compiled(function, None)


def innermost(function: _Function) -> _Function:
    """Compile a loop over lanes into the kernels that call it: arrays are taken to be apart.

    What it writes to may not overlap with anything else that it is given, and it may not slice:
    a kernel hands it the rows.
    """
    return _compiled(function, None, pipeline_class=_Apart, forceinline=True)


def kernel_for(signature: str) -> Callable[[_Function], _Function]:
    """Compile a loop for one signature at import, so that no first call waits for it."""
    return lambda function: _compiled(function, signature)


class _Apart(Compiler):
    """Numba's compiler, told that no two arguments overlap."""

    def define_pipelines(self) -> Any:
        """The usual steps."""
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


def _compiled(function: _Function, signature: str | None, **options: Any) -> _Function:
    before = config.CACHE_DIR  # type: ignore[attr-defined]
    config.CACHE_DIR = str(cache_folder())  # type: ignore[attr-defined]
    try:
        compiled = njit(cache=True, error_model="numpy", **options)(function)
    finally:
        config.CACHE_DIR = before  # type: ignore[attr-defined]
    if isinstance(compiled, Dispatcher):  # otherwise Numba was told to compile nothing
        store = compiled._cache  # type: ignore[attr-defined]
        store._cache_file = _LockedIndex(  # type: ignore[no-untyped-call]
            store._cache_path, store._impl.filename_base, store._impl.locator.get_source_stamp()
        )
        _compile_once(compiled, f"{Path(store._cache_path).name}-{store._impl.filename_base}")
        if signature is not None:
            compiled.compile(signature)
            compiled.disable_compile()
    return cast("_Function", compiled)


def _compile_once(function: Dispatcher, name: str) -> None:
    """Let one process at a time look for a compiled function and compile it.

    No two can wait for each other: the process that compiles a function holds its lock and then
    those of the functions that it calls, never the other way, and one thread of a process at a
    time.
    """
    load_or_compile = function.compile

    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock, _alone(cache_folder() / f"{name}.lock"):
            return load_or_compile(signature)

    function.compile = compile_alone  # type: ignore[assignment, method-assign]


class _LockedIndex(IndexDataCacheFile):
    """Index and machine code of one function, read and written by one process at a time."""

    def save(self, key: object, data: object) -> None:
        """Keep what was compiled."""
        with _alone(cache_folder() / "lock"):
            super().save(key, data)  # type: ignore[no-untyped-call]

    def load(self, key: object) -> object:
        """Return what was compiled; None when it was not."""
        with _alone(cache_folder() / "lock"):
            return cast("object", super().load(key))  # type: ignore[no-untyped-call]


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Hold a lock among the processes of a machine; go on where there is none to be had."""
    with ExitStack() as held:
        if sys.platform != "win32":
            import fcntl

            with suppress(OSError):  # the folder is gone, or on a file system without locks
                file = held.enter_context(lock.open("a"))
                fcntl.flock(file, fcntl.LOCK_EX)
        yield
