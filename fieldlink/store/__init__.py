"""The historian: append-only tables, written by a thread, read as pandas frames.

Nothing here asks a device or decides what is recorded; records come in, queries go out.
"""

from fieldlink.store.backup import Backup, back_up
from fieldlink.store.errors import StoreAwayError, StoreError
from fieldlink.store.event_stream import EventStream
from fieldlink.store.export import EXPORTED_TABLES, Export, export
from fieldlink.store.fleet_reader import FleetReader
from fieldlink.store.former_names import RENAMED
from fieldlink.store.historian import Historian
from fieldlink.store.housekeeping import Retention
from fieldlink.store.last_blocks import last_blocks, newest_blocks
from fieldlink.store.last_events import last_events
from fieldlink.store.last_findings import CLOSED, open_findings
from fieldlink.store.queries import (
    read_averages,
    read_estimates,
    read_events,
    read_samples,
    read_slots,
    read_writebacks,
)
from fieldlink.store.records import (
    DiagnosisRecord,
    EstimateRecord,
    EventRecord,
    FindingRecord,
    Record,
    SampleRecord,
    SlotRecord,
    WorkRecord,
    WritebackRecord,
)
from fieldlink.store.sample_stretches import SampleReader
from fieldlink.store.settings_and_counts import HistorianSettings, StoreReport
from fieldlink.store.work_notes import REPAIR_KINDS, WORK_DONE, WORK_STATES, record_work
from fieldlink.store.writers import Writer

__all__ = [
    "CLOSED",
    "EXPORTED_TABLES",
    "RENAMED",
    "REPAIR_KINDS",
    "WORK_DONE",
    "WORK_STATES",
    "Backup",
    "DiagnosisRecord",
    "EstimateRecord",
    "EventRecord",
    "EventStream",
    "Export",
    "FindingRecord",
    "FleetReader",
    "Historian",
    "HistorianSettings",
    "Record",
    "Retention",
    "SampleReader",
    "SampleRecord",
    "SlotRecord",
    "StoreAwayError",
    "StoreError",
    "StoreReport",
    "WorkRecord",
    "WritebackRecord",
    "Writer",
    "back_up",
    "export",
    "last_blocks",
    "last_events",
    "newest_blocks",
    "open_findings",
    "read_averages",
    "read_estimates",
    "read_events",
    "read_samples",
    "read_slots",
    "read_writebacks",
    "record_work",
]
