"""The part of ``/metrics`` that is about findings and notices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from fieldlink.daemon import DaemonStatus

__all__ = ["metrics_of_findings"]


def metrics_of_findings(status: DaemonStatus) -> Iterator[Metric]:
    """Yield what is known of causes, findings and notices; nothing where they are off."""
    if status.findings is not None:
        yield from _of_diagnoses(status)
    if status.notices is not None:
        yield from _of_notices(status)


def _of_diagnoses(status: DaemonStatus) -> Iterator[Metric]:
    report = status.findings
    assert report is not None
    open_now = GaugeMetricFamily(
        "fieldlink_findings", "Findings that are not closed.", labels=["cause", "state"]
    )
    for (cause, state), count in Counter((one.cause, one.state) for one in report.open).items():
        open_now.add_metric([cause, state.value], count)
    causes = GaugeMetricFamily(
        "fieldlink_loop_cause",
        "1 for the heaviest cause of the loop's last diagnosis.",
        labels=["loop", "device", "cause"],
    )
    for name, cause in report.causes.items():
        if name in status.loops:
            causes.add_metric([name, status.loops[name].device, cause], 1.0)
    diagnosed = CounterMetricFamily(
        "fieldlink_diagnoses", "Windows diagnosed, by outcome.", labels=["outcome"]
    )
    for outcome, count in report.diagnosed.items():
        diagnosed.add_metric([outcome], count)
    yield from (
        open_now,
        causes,
        diagnosed,
        CounterMetricFamily(
            "fieldlink_diagnosis_rounds", "Rounds of diagnoses that ended.", report.rounds
        ),
    )


def _of_notices(status: DaemonStatus) -> Iterator[Metric]:
    report = status.notices
    assert report is not None
    notices = CounterMetricFamily(
        "fieldlink_notices",
        "Notices by receiver: delivered, attempts that failed, and given up.",
        labels=["receiver", "outcome"],
    )
    for name, receiver in report.receivers.items():
        for outcome in ("delivered", "failed", "given_up"):
            notices.add_metric([name, outcome], getattr(receiver, outcome))
    yield from (
        notices,
        GaugeMetricFamily(
            "fieldlink_notices_held", "Notices that wait for the hour to be over.", report.held
        ),
    )
