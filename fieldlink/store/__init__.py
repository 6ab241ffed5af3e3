"""The historian: append-only tables, written by a thread, read as pandas frames."""

from fieldlink.store.errors import StoreError
from fieldlink.store.historian import Historian, HistorianSettings, StoreReport
from fieldlink.store.queries import (
    read_estimates,
    read_events,
    read_samples,
    read_writebacks,
)
from fieldlink.store.records import (
    EstimateRecord,
    EventRecord,
    Record,
    SampleRecord,
    WritebackRecord,
)

__all__ = [
    "EstimateRecord",
    "EventRecord",
    "Historian",
    "HistorianSettings",
    "Record",
    "SampleRecord",
    "StoreError",
    "StoreReport",
    "WritebackRecord",
    "read_estimates",
    "read_events",
    "read_samples",
    "read_writebacks",
]
