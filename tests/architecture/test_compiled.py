"""Compiled kernels: strict arithmetic, and one cache folder for one state of the sources."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

from compiled import _LockedIndex, cache_folder, kernel, source_hash
from estimator.algebra import dot

ROOT = Path(__file__).resolve().parents[2]
KERNELS = [ROOT / "compiled.py", *sorted((ROOT / "estimator").rglob("*.py"))]

CALLEE = (
    "from compiled import kernel\n\n@kernel\ndef inner(x: float) -> float:\n    return x + {}\n"
)
CALLER = """
from compiled import kernel
from estimator.callee import inner

@kernel
def outer(x: float) -> float:
    return 10.0 * inner(x)
"""
RUN = """
from compiled import cache_folder
from estimator.caller import outer
print(outer(1.0), cache_folder())
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package with one kernel that calls another one in another file."""
    root = tmp_path / "root"
    (root / "estimator").mkdir(parents=True)
    shutil.copy(ROOT / "compiled.py", root)
    (root / "estimator" / "__init__.py").write_text("")
    (root / "estimator" / "callee.py").write_text(CALLEE.format("1.0"))
    (root / "estimator" / "caller.py").write_text(CALLER)
    return root


def _run(root: Path, folder: Path) -> tuple[float, Path]:
    """What the caller's kernel gives in a process of its own, and its cache folder."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", RUN], cwd=root, env=env, capture_output=True, text=True, check=True
    )
    value, used = done.stdout.split(maxsplit=1)
    return float(value), Path(used.strip())


def _kernels(folder: Path) -> dict[Path, int]:
    """Compiled kernels with the times when they were written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nb?")}


def test_a_changed_callee_is_compiled_again_and_an_unchanged_one_is_not(
    package: Path, tmp_path: Path
) -> None:
    named = tmp_path / "named"
    value, folder = _run(package, named)
    assert value == 20.0
    assert folder.parent == named  # the folder that the user names goes first
    written = _kernels(folder)
    assert written
    assert _run(package, named) == (20.0, folder)
    assert _kernels(folder) == written
    (package / "estimator" / "callee.py").write_text(CALLEE.format("2.0"))
    value, other = _run(package, named)
    assert value == 30.0
    assert other != folder


def test_without_a_named_folder_kernels_are_beside_the_sources(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    folder = cache_folder.__wrapped__()
    assert folder.parent in {ROOT / "__pycache__", Path.home() / ".cache" / "fieldlink"}
    assert folder.is_dir()


def test_the_hash_changes_with_every_source_and_with_nothing_else(package: Path) -> None:
    seen = {source_hash(package)}
    (package / "estimator" / "notes.txt").write_text("no kernel")
    assert source_hash(package) in seen
    for name in ("callee.py", "caller.py", "__init__.py", "new.py", "../compiled.py"):
        with (package / "estimator" / name).open("a") as file:
            file.write("# another line\n")
        assert source_hash(package) not in seen
        seen.add(source_hash(package))


def test_the_cache_of_this_process_holds_the_hash_of_its_sources() -> None:
    assert cache_folder().name.endswith(source_hash(ROOT))


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_nothing_but_the_strict_compiler_compiles(path: Path) -> None:
    tree = ast.parse(path.read_text())
    loose = [n for n in ast.walk(tree) if isinstance(n, ast.keyword) and n.arg == "fastmath"]
    assert loose == []
    parallel = [n for n in ast.walk(tree) if isinstance(n, ast.keyword) and n.arg == "parallel"]
    assert parallel == []
    if path.name != "compiled.py":
        imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        imported |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
        assert not {name for name in imported if name and name.split(".")[0] == "numba"}


def test_a_kernel_s_sum_has_the_bits_of_a_plain_loop() -> None:
    # every 32nd product in a sum of its own, then the rest in four and these sums in the four;
    # otherwise neither reordered nor fused: Python's own floats give the same bits
    rng = np.random.default_rng(0)
    for n in (1, 7, 64, 1001):
        a, b = rng.normal(size=n), rng.normal(size=n) * 10.0 ** rng.integers(-8, 8, n)
        products = [x * y for x, y in zip(a.tolist(), b.tolist(), strict=True)]
        sums, t = [0.0] * 32, [0.0] * 4
        whole = n - n % 128
        for i, product in enumerate(products[:whole]):
            sums[i % 32] += product
        rest = products[whole:]
        for i, product in enumerate(rest):
            t[i % 4 if i < len(rest) - len(rest) % 4 else 0] += product
        for i, part in enumerate(sums):
            t[i % 4] += part
        assert dot(a, b) == (t[0] + t[1]) + (t[2] + t[3])


def test_a_division_by_zero_in_a_kernel_is_numpy_s() -> None:
    @kernel
    def divide(a: float, b: float) -> float:
        return a / b

    assert divide(1.0, 0.0) == np.inf
    assert np.isnan(divide(0.0, 0.0))


STORE = """
import sys, time
from pathlib import Path
from compiled import _LockedIndex

class Slow(_LockedIndex):
    def _save_index(self, overloads):
        time.sleep(0.002)
        super()._save_index(overloads)

folder, name, other = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
(folder / name).touch()
while not (folder / other).exists():
    time.sleep(0.001)
mine = Slow(folder, "outer", 0)
for number in range(30):
    mine.save((name, number), (name, number))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such lock there")
def test_processes_that_compile_at_once_keep_each_their_own(package: Path, tmp_path: Path) -> None:
    """Numba's index alone loses and mixes up what two processes add at the same time."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    running = [
        subprocess.Popen([sys.executable, "-c", STORE, str(tmp_path), *names], cwd=package, env=env)
        for names in (("one", "other"), ("other", "one"))
    ]
    assert [process.wait(60) for process in running] == [0, 0]
    kept = IndexDataCacheFile(str(tmp_path), "outer", 0)
    keys = [(name, number) for name in ("one", "other") for number in range(30)]
    assert [kept.load(key) for key in keys] == keys


COMPILE = """
import sys, time
from pathlib import Path
from numba.core.dispatcher import _FunctionCompiler
from estimator.caller import outer

compile_it = _FunctionCompiler.compile

def slowly(self, args, return_type):
    (folder / f"{self.py_func.__name__}-{name}").touch()
    time.sleep(0.2)
    return compile_it(self, args, return_type)

_FunctionCompiler.compile = slowly
folder, name, other = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
(folder / name).touch()
while not (folder / other).exists():
    time.sleep(0.001)
assert outer(1.0) == 20.0
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such lock there")
def test_one_of_the_processes_that_need_a_kernel_compiles_it(package: Path, tmp_path: Path) -> None:
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", COMPILE, str(tmp_path)]
    running = [
        subprocess.Popen([*command, *names], cwd=package, env=env)
        for names in (("one", "other"), ("other", "one"))
    ]
    assert [process.wait(120) for process in running] == [0, 0]
    for function in ("outer", "inner"):
        assert len(list(tmp_path.glob(f"{function}-*"))) == 1


def test_every_kernel_has_the_locked_index() -> None:
    assert isinstance(dot._cache._cache_file, _LockedIndex)
