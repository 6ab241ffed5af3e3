"""The work list of a fleet and its reports: rows, evidence, and pages for screen, paper, tables.

Reads the historian and recordings; nothing here talks to a device or runs inside a loop's scan.
"""

from fieldlink.worklist.audience import AUDIENCES, Audience
from fieldlink.worklist.document import WorkDocument
from fieldlink.worklist.errors import ReportError
from fieldlink.worklist.finding import (
    Action,
    Cause,
    Finding,
    Wrong,
    finding_of_diagnosis,
    finding_of_estimate,
)
from fieldlink.worklist.from_recordings import judge_recordings
from fieldlink.worklist.from_store import ReportedLoop, list_loops
from fieldlink.worklist.partial import PartialReport
from fieldlink.worklist.row import COLUMNS, WorkItem, WorkRow
from fieldlink.worklist.settings import WorkListSettings
from fieldlink.worklist.writing import FORMATS, format_of, render, write_report

__all__ = [
    "AUDIENCES",
    "COLUMNS",
    "FORMATS",
    "Action",
    "Audience",
    "Cause",
    "Finding",
    "PartialReport",
    "ReportError",
    "ReportedLoop",
    "WorkDocument",
    "WorkItem",
    "WorkListSettings",
    "WorkRow",
    "Wrong",
    "finding_of_diagnosis",
    "finding_of_estimate",
    "format_of",
    "judge_recordings",
    "list_loops",
    "render",
    "write_report",
]
