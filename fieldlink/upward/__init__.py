"""The way upward: what the daemon knows goes to an MQTT broker, as JSON and as Sparkplug B.

Nothing here reads or writes a device; commands from above go through the daemon's own doors.
"""

from fieldlink.upward.commands import CommandDesk
from fieldlink.upward.counts import FormatReport, UpwardReport
from fieldlink.upward.errors import UpwardError
from fieldlink.upward.publishing import Publishing

__all__ = ["CommandDesk", "FormatReport", "Publishing", "UpwardError", "UpwardReport"]
