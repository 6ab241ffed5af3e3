"""What all estimator processes have in common: imported once, by the fork server alone.

Workers are forked from it and share its memory. The garbage collector would write into every object
that it looks at, and so make a copy of nearly all of it in each of them: what is there by now is
taken out of its sight.

Ctrl-C in a terminal reaches them all: the daemon alone decides when they end, also while they
import.
"""

# ruff: noqa: E402

from __future__ import annotations

import gc
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)

import estimator
import fieldlink.daemon.estimation.estimating

__all__ = ["SHARED"]

SHARED = (estimator, fieldlink.daemon.estimation.estimating)

gc.collect()
gc.freeze()
