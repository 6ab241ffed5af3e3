"""A historian of a made-up fleet: estimates over weeks, and the samples of each newest window.

Windows are simulated loops; one sticky and one healthy window are judged by the estimator, and the
other estimates are theirs with another stick band, verdict or reason. Nothing here measures the
estimator: it is for what reads a historian.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator import ReasonCode, identify
from fieldlink.store import EstimateRecord, EventRecord, Record, SampleRecord
from fieldlink.store.database import open_for_writing
from fieldlink.store.inserting import insert_batch
from loop_model import ProcessModel, ValveModel

KINDS = (
    "growing", "steady", "repaired", "uncertain", "manual", "disturbed",
    "healthy", "healthy", "healthy", "healthy",
)  # fmt: skip
"""What is wrong with a loop, by the last digit of its number: four in ten are healthy."""

WINDOW = 800
DAY_MS = 86_400_000
END_MS = 1_772_000_000_000
"""End of the newest window."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fleet:
    """How many loops, how many days of daily estimates, and where."""

    file: Path
    loops: int = 200
    days: int = 365

    @property
    def url(self) -> str:
        """The historian's address."""
        return f"sqlite:///{self.file}"

    def name(self, number: int) -> str:
        """Name of a loop."""
        return f"FC{101 + number}"


def make_fleet(fleet: Fleet, kinds: Sequence[str] = KINDS) -> None:
    """Write the historian; loops have ``kinds`` in turn."""
    templates = {"sticky": _judge(4.0), "healthy": _judge(0.0)}
    opened = EventRecord(END_MS - fleet.days * DAY_MS, "daemon.start", "daemon", "made-up fleet")
    engine = open_for_writing(fleet.url, opened)
    try:
        for number in range(fleet.loops):
            kind = kinds[number % len(kinds)]
            rng = np.random.default_rng(number)
            records = list(_estimates(fleet, number, kind, templates, rng))
            insert_batch(engine, records)
            document = records[-1].document
            sticks = document is not None and document["verdict"] == "stiction"
            band = records[-1].stick_band if sticks else None
            insert_batch(engine, list(_samples(fleet.name(number), kind, band or 0.0, rng)))
    finally:
        engine.dispose()


def simulate_window(stick_band: float, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Return OP, PV and SP of a lag under PI control behind a valve, in %."""
    valve = ValveModel(stick_band, 0.4 * stick_band)
    process = ProcessModel(a=(-0.9,), b=(0.1,), dead_time=1, offset=0.0, period=1.0)
    op, pv, sp = np.empty(WINDOW), np.empty(WINDOW), np.empty(WINDOW)
    stem = y = integral = 45.0
    disturbance = 0.0
    for k in range(WINDOW):
        sp[k] = (45.0, 46.3, 44.6, 45.5)[k // 200 % 4]
        pv[k] = y + 0.03 * rng.standard_normal()
        error = sp[k] - pv[k]
        integral += 0.16 * error
        op[k] = 1.6 * error + integral
        stem = valve.step(stem, float(op[k]))
        disturbance = 0.95 * disturbance + 0.02 * rng.standard_normal()
        y = -process.a[0] * y + process.b[0] * stem + 0.1 * disturbance
    return op, pv, sp


def _judge(stick_band: float) -> dict[str, Any]:
    op, pv, sp = simulate_window(stick_band, np.random.default_rng(1))
    return identify(op, pv, sp=sp, period=1.0).to_dict()


def _estimates(
    fleet: Fleet,
    number: int,
    kind: str,
    templates: Mapping[str, Mapping[str, Any]],
    rng: np.random.Generator,
) -> Iterator[EstimateRecord]:
    size = 2.0 + 3.0 * rng.random()
    for day in range(fleet.days):
        end = END_MS - (fleet.days - 1 - day) * DAY_MS
        share = day / max(1, fleet.days - 1)
        document = _document(kind, share, size, templates, rng)
        S, J = document["stick_band"], document["slip_jump"]
        yield EstimateRecord(
            loop=fleet.name(number),
            utc_ms=end + 2000,
            window_end_ms=end,
            first_slot=day * 86_400,
            last_slot=day * 86_400 + WINDOW - 1,
            outcome="estimated",
            message="; ".join(document["reasons"]),
            verdict=document["verdict"],
            score=document["score"],
            stick_band=S["value"],
            stick_band_low=S["low"],
            stick_band_high=S["high"],
            slip_jump=J["value"],
            slip_jump_low=J["low"],
            slip_jump_high=J["high"],
            confidence=document["confidence"],
            r2=document["fit"]["r2"],
            criterion=document["criterion"],
            seconds=document["seconds"],
            document=document,
        )


def _document(
    kind: str,
    share: float,
    size: float,
    templates: Mapping[str, Mapping[str, Any]],
    rng: np.random.Generator,
) -> dict[str, Any]:
    sticky = kind in ("growing", "steady", "uncertain") or (kind == "repaired" and share < 0.8)
    document: dict[str, Any] = copy.deepcopy(dict(templates["sticky" if sticky else "healthy"]))
    if sticky:
        band = size * (0.6 + 0.8 * share if kind == "growing" else 1.0)
        band += 0.1 * rng.standard_normal()
        document["stick_band"] = {"value": band, "low": band - 0.2, "high": band + 0.2}
        document["slip_jump"] = {"value": 0.4 * band, "low": 0.3 * band, "high": 0.5 * band}
    if kind == "uncertain":
        _say(document, "stiction", ReasonCode.UNCERTAIN, "the evidence is near its threshold")
        document["uncertain"] = True
    elif kind == "manual":
        said = "the controller is in manual for 92 % of the window"
        _say(document, "not_assessable", ReasonCode.NOT_IN_AUTOMATIC, said)
        document["stick_band"] = document["slip_jump"] = dict.fromkeys(("value", "low", "high"))
    elif kind == "disturbed":
        said = "a sinusoid of 85 s from outside explains PV better than any valve"
        _say(document, "no_stiction", ReasonCode.DISTURBANCE_EXPLAINS, said)
    return document


def _say(document: dict[str, Any], verdict: str, code: ReasonCode, text: str) -> None:
    document["verdict"] = verdict
    document["reasons"], document["advice"] = [text], [code.advice]
    document["reason_codes"] = [code.value]


def _samples(loop: str, kind: str, stick_band: float, rng: np.random.Generator) -> Iterator[Record]:
    op, pv, sp = simulate_window(stick_band, rng)
    begin = END_MS - 1000 * (WINDOW - 1)
    for k in range(WINDOW):
        yield SampleRecord(
            loop, begin + 1000 * k, 86_400_000 + k, float(op[k]), float(pv[k]), float(sp[k]),
            kind != "manual", 0,
        )  # fmt: skip
