"""After the warm-up a window waits for no kernel."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

JUDGE = """
import gc, json
import numpy as np
from numba.core.dispatcher import Dispatcher
from benchmarks.examples import EXAMPLES, example_window
from estimator import diagnosis, identify, warm_up
from tests.closed_loop import run
from tests.estimator.test_uneven_wave import uneven_wave

def loaded():
    kernels = [o for o in gc.get_objects() if isinstance(o, Dispatcher)]
    return {
        f"{one.py_func.__module__}.{one.py_func.__qualname__} {signature}"
        for one in kernels
        for signature in one.signatures
        if one.py_func.__module__.startswith("estimator")
    }

warm_up()
diagnosis.warm_up()
before = loaded()
sticky = run(band=6.0, jump=4.0, seed=3)
wave = run(load=4.0 * np.sin(np.arange(1500) / 11.0), seed=4)
load = 4.0 * uneven_wave(900, 80.0, 0.05, 1)
uneven = run(load=load, n=900, noise=0.05, gain=0.5, seed=1)
loops = [(one.op, one.pv) for one in (sticky, wave, uneven, run(seed=5))]
examples = [example_window(one, 0) for one in EXAMPLES]
for op, pv in [*loops, *[(one.op, one.pv) for one in examples]]:
    identify(op, pv)
    diagnosis.diagnose(op, pv)
print(json.dumps([len(before), sorted(loaded() - before)]))
"""


@pytest.mark.thorough
def test_usual_windows_need_no_kernel_that_the_warm_up_left_out() -> None:
    command = [sys.executable, "-c", JUDGE]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    loaded, late = json.loads(done.stdout)
    assert loaded > 30
    assert late == []
