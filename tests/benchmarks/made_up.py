"""A loop that is easy in every way, to vary from."""

from __future__ import annotations

from benchmarks.loops import Loop

__all__ = ["BASE"]

BASE = Loop(
    seed=1,
    plant="first order",
    controller="PI",
    physics="He",
    noise_kind="white",
    stick_band=4.0,
    slip_jump=1.0,
    noise=0.05,
    disturbance=0.0,
    sampling=0.2,
    dead_time=0,
    aggressive=1.0,
    trouble="none",
)
