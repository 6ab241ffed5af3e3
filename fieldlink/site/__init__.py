"""The site file: where the signals are, what they mean, and what is to be done with them.

    site = load_site("site_configs/demo.toml")
    site.loops["FC101"].period, site.tag("FC101", "op"), site.requests("plc")

Everything is checked when a site is loaded; what is wrong is a `SiteError` that lists all of it.
"""

from fieldlink.site.check_report import CheckReport, check
from fieldlink.site.checked_site import Site
from fieldlink.site.device import Device, Quirks, Tls
from fieldlink.site.errors import Problem, RecordingError, SiteError
from fieldlink.site.load import load_site, schema
from fieldlink.site.models import (
    EstimatorSettings,
    HistorianTable,
    Loop,
    PiSettings,
    PlantSettings,
    WriteBack,
    WriteLimits,
)
from fieldlink.site.recording import Recording, read_recording
from fieldlink.site.register_map import read_register_map

__all__ = [
    "CheckReport",
    "Device",
    "EstimatorSettings",
    "HistorianTable",
    "Loop",
    "PiSettings",
    "PlantSettings",
    "Problem",
    "Quirks",
    "Recording",
    "RecordingError",
    "Site",
    "SiteError",
    "Tls",
    "WriteBack",
    "WriteLimits",
    "check",
    "load_site",
    "read_recording",
    "read_register_map",
    "schema",
]
