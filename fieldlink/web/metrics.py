"""A snapshot of the daemon in the format that Prometheus reads.

Every figure is a count or a state that the daemon keeps anyway; nothing is measured for a scrape.
Counts start again when the daemon does, as Prometheus expects.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)

from fieldlink.daemon import (
    LATENESS_BOUNDS,
    DaemonStatus,
    EstimateOutcome,
    LoopStatus,
    WritebackOutcome,
)
from fieldlink.links import LinkState
from fieldlink.web.finding_metrics import metrics_of_findings

__all__ = ["collect_metrics", "render_metrics"]

VERDICTS = ("stiction", "no_stiction", "not_assessable")

NOT_TAKEN = (
    WritebackOutcome.REJECTED,
    WritebackOutcome.NOT_ACKNOWLEDGED,
    WritebackOutcome.WRITE_FAILED,
    WritebackOutcome.READBACK_DIFFERS,
    WritebackOutcome.COMMIT_FAILED,
    WritebackOutcome.CONTESTED,
    WritebackOutcome.DISAGREES,
)
"""Outcomes that a loop which may be written has from the start, as 0: Prometheus sees no increase
in a count that is there only once it is 1."""

_process = CollectorRegistry()
ProcessCollector(registry=_process)


def render_metrics(status: DaemonStatus) -> bytes:
    """Return the text of ``/metrics``."""
    return generate_latest(_Snapshot(status)) + generate_latest(_process)


class _Snapshot(CollectorRegistry):
    """A registry of one moment."""

    def __init__(self, status: DaemonStatus) -> None:
        super().__init__()
        self._status = status

    def collect(self) -> Iterator[Metric]:
        yield from collect_metrics(self._status)


def collect_metrics(status: DaemonStatus) -> Iterator[Metric]:
    """Give every metric of the daemon with its samples, without those of its process."""
    yield from _of_loops(status)
    yield from _of_devices(status)
    yield from _of_the_store(status)
    yield from _of_the_daemon(status)
    yield from _of_the_broker(status)
    yield from metrics_of_findings(status)


def _of_loops(status: DaemonStatus) -> Iterator[Metric]:
    names = ["loop", "device"]
    slots = CounterMetricFamily(
        "fieldlink_loop_slots",
        "Samples that a loop should have given, by outcome: expected = read + bad + "
        "missed; late ones are counted among read and bad too.",
        labels=[*names, "outcome"],
    )
    idle = GaugeMetricFamily(
        "fieldlink_loop_seconds_since_sample",
        "Plant seconds since the newest sample.",
        labels=names,
    )
    period = GaugeMetricFamily(
        "fieldlink_loop_window_filled_ratio", "How much of the window is there.", labels=names
    )
    estimates = CounterMetricFamily(
        "fieldlink_loop_estimates", "Windows of the loop that were judged.", labels=names
    )
    verdict = GaugeMetricFamily(
        "fieldlink_loop_verdict", "1 for the last window's verdict.", labels=[*names, "verdict"]
    )
    stick_band = GaugeMetricFamily(
        "fieldlink_loop_stick_band",
        "Stick band S of the last window in units of OP, and the bounds of its interval.",
        labels=[*names, "bound"],
    )
    slip_jump = GaugeMetricFamily(
        "fieldlink_loop_slip_jump",
        "Slip jump J of the last window in units of OP, and the bounds of its interval.",
        labels=[*names, "bound"],
    )
    score = GaugeMetricFamily(
        "fieldlink_loop_score", "Evidence for stiction in the last window.", labels=names
    )
    writebacks = CounterMetricFamily(
        "fieldlink_loop_writebacks",
        "Attempts to write a parameter block and decisions not to, by outcome.",
        labels=[*names, "outcome"],
    )
    for name, loop in status.loops.items():
        own = [name, loop.device]
        counts = loop.counts
        for outcome in ("expected", "read", "late", "missed", "bad"):
            slots.add_metric([*own, outcome], getattr(counts, outcome))
        idle.add_metric(own, loop.idle)
        period.add_metric(own, loop.filled)
        estimates.add_metric(own, loop.estimates)
        for outcome, count in _writebacks(loop).items():
            writebacks.add_metric([*own, outcome], count)
        found = None if loop.last_estimate is None else loop.last_estimate.findings
        if found is None:
            continue
        for known in VERDICTS:
            verdict.add_metric([*own, known], float(found.verdict == known))
        score.add_metric(own, found.score)
        for family, interval in ((stick_band, found.stick_band), (slip_jump, found.slip_jump)):
            for bound in ("value", "low", "high"):
                family.add_metric([*own, bound], getattr(interval, bound))
    yield from (slots, idle, period, estimates, verdict, stick_band, slip_jump, score, writebacks)


def _writebacks(loop: LoopStatus) -> dict[str, int]:
    begun = {outcome.code: 0 for outcome in NOT_TAKEN} if loop.may_write else {}
    return begun | dict(loop.outcomes)


def _of_devices(status: DaemonStatus) -> Iterator[Metric]:
    state = GaugeMetricFamily(
        "fieldlink_device_state", "1 for the device's state.", labels=["device", "state"]
    )
    polls = CounterMetricFamily("fieldlink_device_polls", "Scans made.", labels=["device"])
    skipped = CounterMetricFamily(
        "fieldlink_device_skipped_polls",
        "Scans left out because the one before took too long.",
        labels=["device"],
    )
    requests = CounterMetricFamily("fieldlink_device_requests", "Requests sent.", labels=["device"])
    failures = CounterMetricFamily(
        "fieldlink_device_failures", "Errors met while scanning.", labels=["device"]
    )
    connects = CounterMetricFamily(
        "fieldlink_device_connects", "Times the connection was opened.", labels=["device"]
    )
    late_replies = CounterMetricFamily(
        "fieldlink_device_late_replies",
        "Replies that came after their time-out and were passed over.",
        labels=["device"],
    )
    quarantined = GaugeMetricFamily(
        "fieldlink_device_quarantined_tags",
        "Tags left out for now because the device refuses their registers.",
        labels=["device"],
    )
    lateness = HistogramMetricFamily(
        "fieldlink_reply_lateness_seconds",
        "From the moment a poll was due to the reply with a loop's sample.",
        labels=["device"],
    )
    for name, device in status.devices.items():
        for known in LinkState:
            state.add_metric([name, known.name.lower()], float(device.state is known))
        polls.add_metric([name], device.polls)
        skipped.add_metric([name], device.late)
        requests.add_metric([name], device.requests)
        failures.add_metric([name], device.failures)
        connects.add_metric([name], device.connects)
        late_replies.add_metric([name], device.late_replies)
        quarantined.add_metric([name], len(device.quarantined))
        edges = [*map(str, LATENESS_BOUNDS), "+Inf"]
        counted = list(zip(edges, accumulate(device.lateness.counts), strict=True))
        lateness.add_metric([name], counted, device.lateness.total)
    yield from (state, polls, skipped, requests, failures)
    yield from (connects, late_replies, quarantined, lateness)


def _of_the_store(status: DaemonStatus) -> Iterator[Metric]:
    store = status.store
    yield from (
        CounterMetricFamily("fieldlink_store_written", "Rows in the store.", store.written),
        CounterMetricFamily("fieldlink_store_lost", "Records lost.", store.dropped),
        CounterMetricFamily("fieldlink_store_retries", "Writes that failed.", store.retries),
        CounterMetricFamily(
            "fieldlink_store_removed", "Rows that the retention removed.", store.removed
        ),
        CounterMetricFamily(
            "fieldlink_store_set_aside", "Damaged files that were replaced.", store.set_aside
        ),
        CounterMetricFamily(
            "fieldlink_store_gone",
            "Times the store's file was found deleted, moved or replaced.",
            store.gone,
        ),
        GaugeMetricFamily("fieldlink_store_waiting", "Records that wait.", store.waiting),
        GaugeMetricFamily(
            "fieldlink_store_failing", "1 while the store cannot be written.", store.failing
        ),
    )


def _of_the_broker(status: DaemonStatus) -> Iterator[Metric]:
    upward = status.upward
    if upward is None:
        return
    connected = GaugeMetricFamily(
        "fieldlink_mqtt_connected", "1 while the broker has accepted us.", labels=["format"]
    )
    delivered = CounterMetricFamily(
        "fieldlink_mqtt_delivered", "Messages that the broker has.", labels=["format"]
    )
    waiting = GaugeMetricFamily(
        "fieldlink_mqtt_waiting", "Messages on disk that the broker has not.", labels=["format"]
    )
    skipped = CounterMetricFamily(
        "fieldlink_mqtt_skipped", "Messages that the broker does not take.", labels=["format"]
    )
    for name, report in upward.formats.items():
        connected.add_metric([name], float(report.connected))
        delivered.add_metric([name], report.delivered)
        waiting.add_metric([name], report.waiting)
        skipped.add_metric([name], report.skipped)
    yield from (
        connected,
        delivered,
        waiting,
        skipped,
        CounterMetricFamily(
            "fieldlink_mqtt_dropped",
            "Messages lost to the spool's bound or age, or to a disk that could not be written.",
            upward.dropped,
        ),
    )


def _of_the_daemon(status: DaemonStatus) -> Iterator[Metric]:
    pool = status.pool
    judged = CounterMetricFamily(
        "fieldlink_estimator_windows", "Windows judged, by outcome.", labels=["outcome"]
    )
    for outcome in EstimateOutcome:
        judged.add_metric([outcome.code], pool.judged.get(outcome.code, 0))
    reloads = CounterMetricFamily(
        "fieldlink_site_reloads", "Site files read while running.", labels=["result"]
    )
    reloads.add_metric(["taken"], status.reloads)
    reloads.add_metric(["refused"], status.refused)
    yield from (
        judged,
        CounterMetricFamily(
            "fieldlink_estimator_rebuilt",
            "Times the estimator's processes were replaced because one died or hung.",
            pool.rebuilt,
        ),
        GaugeMetricFamily(
            "fieldlink_estimator_waiting", "Windows in judgement or waiting.", pool.waiting
        ),
        GaugeMetricFamily("fieldlink_estimator_workers", "Estimator processes.", pool.workers),
        CounterMetricFamily(
            "fieldlink_clock_steps", "Steps of the wall clock.", status.clock_steps
        ),
        CounterMetricFamily(
            "fieldlink_defects",
            "Unexpected errors; the log names the place.",
            status.defects,
        ),
        reloads,
    )
