"""A store as a large site fills it: loops with a year of daily estimates, samples, blocks, notes.

Used by `benchmarks.web_page` and by the browser tests; the figures are drawn from a seed.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from sqlalchemy import create_engine, insert, select

from fieldlink.store.schema import (
    ESTIMATES,
    EVENTS,
    META,
    METADATA,
    SAMPLES,
    SCHEMA_VERSION,
    SLOTS,
    WRITEBACKS,
)

__all__ = ["fill_store"]

DAY_MS = 86_400_000
CHUNK = 20_000


def fill_store(
    file: Path,
    *,
    now_ms: int,
    loops: int,
    days: int = 365,
    samples: int = 60,
    long_samples: int = 0,
    seed: int = 1,
) -> str:
    """Fill an SQLite historian; return its address.

    Args:
        file: the new file.
        now_ms: the moment of the newest rows, UTC milliseconds.
        loops: number of loops, ``LIC-0001`` and so on; one in five is sticky and grows worse.
        days: daily estimates of each.
        samples: newest samples of each loop, one a second.
        long_samples: samples of the first loop instead.
        seed: of the figures.
    """
    url = f"sqlite:///{file}"
    engine = create_engine(url)
    METADATA.create_all(engine)
    rng = np.random.default_rng(seed)
    names = [f"LIC-{number:04d}" for number in range(1, loops + 1)]
    with engine.begin() as connection:
        connection.exec_driver_sql("PRAGMA journal_mode=WAL")
        connection.execute(insert(META), {"key": "schema", "value": str(SCHEMA_VERSION)})
        rows = []
        for day in range(days):
            at = now_ms - (days - 1 - day) * DAY_MS
            for number, name in enumerate(names):
                rows.append(_estimate(name, number, day, days, at, rng))
            if len(rows) >= CHUNK:
                connection.execute(insert(ESTIMATES), rows)
                rows = []
        if rows:
            connection.execute(insert(ESTIMATES), rows)
        bands = dict(
            connection.execute(
                select(ESTIMATES.c.loop, ESTIMATES.c.stick_band).where(ESTIMATES.c.utc_ms == now_ms)
            ).all()
        )
        for number, name in enumerate(names):
            count = long_samples if long_samples and number == 0 else samples
            connection.execute(insert(SAMPLES), _samples(name, count, now_ms, rng))
            connection.execute(insert(SLOTS), _slots(name, now_ms))
            connection.execute(insert(WRITEBACKS), _attempt(name, number, now_ms, bands[name]))
        connection.execute(
            insert(EVENTS),
            {
                "utc_ms": now_ms - 150 * DAY_MS,
                "kind": "operator.annotate",
                "source": names[0],
                "message": "A. Meyer: packing replaced",
                "detail": {"who": "A. Meyer", "why": "packing replaced"},
            },
        )
    engine.dispose()
    return url


def _estimate(
    name: str, number: int, day: int, days: int, at: int, rng: np.random.Generator
) -> dict[str, object]:
    kind = number % 5
    verdict = "stiction" if kind == 0 else "not_assessable" if kind == 1 else "no_stiction"
    band = 2.0 + 0.01 * (number % 300) + 4.0 * day / days + 0.2 * rng.standard_normal()
    half = 0.25
    sticky = verdict == "stiction"
    document = {
        "verdict": verdict,
        "uncertain": sticky and number % 15 == 0,
        "reasons": ["the likelihood of a sticky valve is higher than that of a healthy one"],
        "advice": ["Check the packing at the next stop."] if sticky else [],
        "fit": {"r2": 0.93, "r2_healthy_valve": 0.41},
        "evidence": {
            "log_bayes_factor": 120.0 if sticky else -12.0,
            "effect": 0.3 + 0.4 * rng.random() if sticky else 0.0,
            "moves": 60,
            "reversals": 24,
            "informed": 0.98,
            "law": "he",
        },
        "samples": 800,
        "period_s": 1.0,
        "process": {"structure": "lag", "gain": 1.2, "dead_time_samples": 3},
        "identifiability": [],
        # What an estimate carries beside these: runners-up, parameters, intervals.
        "rest": "x" * 1800,
        "window": {
            "swing_period_s": 62.0 + number % 40,
            "travel_per_day": 900.0 + number,
            "reversals_per_day": 2400.0,
            "automatic": 1.0,
            "saturated": 0.02,
            "good": 0.999,
        },
    }
    return {
        "loop": name,
        "utc_ms": at,
        "window_end_ms": at,
        "first_slot": day * 86_400,
        "last_slot": day * 86_400 + 799,
        "outcome": "estimated",
        "verdict": verdict,
        "score": 120.0 if sticky else -12.0,
        "stick_band": band if sticky else 0.0,
        "stick_band_low": band - half if sticky else 0.0,
        "stick_band_high": band + half if sticky else 0.0,
        "slip_jump": 0.4 * band if sticky else 0.0,
        "slip_jump_low": 0.4 * band - half if sticky else 0.0,
        "slip_jump_high": 0.4 * band + half if sticky else 0.0,
        "confidence": 0.9,
        "r2": 0.93,
        "criterion": "oe",
        "seconds": 0.4,
        "message": "the likelihood of a sticky valve is higher than that of a healthy one",
        "document": json.loads(json.dumps(document)),
    }


def _samples(
    name: str, count: int, now_ms: int, rng: np.random.Generator
) -> list[dict[str, object]]:
    noise = rng.standard_normal(count)
    return [
        {
            "loop": name,
            "utc_ms": now_ms - (count - 1 - k) * 1000,
            "slot": k,
            "op": 50.0 + 6.0 * abs(((k / 40.0) % 2.0) - 1.0),
            "pv": 60.0 + 3.0 * math.copysign(1.0, math.sin(k * math.pi / 40.0)) + 0.1 * noise[k],
            "sp": 60.0,
            "auto": True,
            "quality": 0,
            "late_ms": 1,
            "clock_steps": 0,
        }
        for k in range(count)
    ]


def _slots(name: str, now_ms: int) -> dict[str, object]:
    counts = {"expected": 60, "read": 59, "late": 0, "missed": 1, "bad": 0}
    return {
        "loop": name, "utc_ms": now_ms, "seconds": 60.0, "duplicates": 0, "restarts": 0, **counts
    }  # fmt: skip


def _attempt(name: str, number: int, now_ms: int, stick_band: float) -> dict[str, object]:
    sticky = number % 5 == 0
    return {
        "loop": name,
        "utc_ms": now_ms - 3_600_000,
        "outcome": "accepted" if sticky else "too_few_windows",
        "reason": "the PLC has taken the block over" if sticky else "1 of 2 windows agree",
        "seq": 7 if sticky else None,
        "bank": "A" if sticky else None,
        "status": "valid" if sticky else "no_stiction",
        "stick_band": stick_band,
        "slip_jump": 0.4 * stick_band,
        "words": [1, 2, 3] if sticky else None,
    }
