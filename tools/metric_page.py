"""The page of the metrics, from what the daemon serves under ``/metrics``."""

from __future__ import annotations

from fieldlink.daemon import DaemonStatus
from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.notices import NoticesReport
from fieldlink.store import StoreReport
from fieldlink.upward import UpwardReport
from fieldlink.web.metrics import collect_metrics
from tools.tables import markdown_table

__all__ = ["metric_page"]

_HEAD = """# Metrics

`/metrics` of the daemon serves these in the format that Prometheus reads, and the figures of its
process (`process_...`). Counts start again when the daemon does. What to look at first is in
[operation](../operations.md#health-and-metrics).
"""


def metric_page() -> str:
    """Return the page in Markdown."""
    status = DaemonStatus(
        devices={},
        loops={},
        store=StoreReport(),
        upward=UpwardReport(),
        findings=FindingsReport(),
        notices=NoticesReport(),
    )
    rows = []
    for metric in collect_metrics(status):
        suffix = "_total" if metric.type == "counter" else ""
        labels = ", ".join(f"`{label}`" for label in getattr(metric, "_labelnames", ()))
        rows.append((f"`{metric.name}{suffix}`", metric.type, labels, metric.documentation))
    return f"{_HEAD}\n{markdown_table(('metric', 'type', 'labels', 'meaning'), rows)}"
