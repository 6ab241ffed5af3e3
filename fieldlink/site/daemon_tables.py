"""The tables of a site file that are about the daemon itself: history, processes, endpoints."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from fieldlink.site.base import is_loopback
from fieldlink.site.device import Model, Seconds

__all__ = ["EstimationSettings", "HistorianTable", "ReportSettings", "WebSettings"]

LONGEST_DAYS = 36_500
"""A century: for ever is the key left out."""


class HistorianTable(Model):
    """``[historian]``: where samples, estimates and write-backs are stored."""

    url: str = "sqlite:///history.sqlite"
    """SQLAlchemy URL; an SQLite path is relative to data_dir."""
    retention_days: float | None = Field(default=None, ge=0.001, le=LONGEST_DAYS)
    """Days that samples are kept; for ever unless given."""
    average_minutes: float | None = Field(default=None, ge=0.01, le=1440)
    """Length of the averages that older samples become; they are dropped unless given."""
    averages_days: float | None = Field(default=None, ge=0.001, le=LONGEST_DAYS)
    """Days that averages are kept; for ever unless given."""
    max_megabytes: float = Field(default=10_000.0, ge=10, le=1e9)
    """Size of an SQLite historian above which the oldest samples go before their time."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.average_minutes is not None and self.retention_days is None:
            raise ValueError(
                "average_minutes says what samples older than retention_days become; "
                "give retention_days"
            )
        return self


class EstimationSettings(Model):
    """``[estimation]``: the processes in which windows are judged."""

    workers: int | None = Field(default=None, ge=1, le=256)
    """Processes; one less than the machine has cores unless given."""
    window_seconds: Seconds = 60.0
    """Seconds that one window may take; then its process is ended."""
    memory_megabytes: float = Field(default=1500.0, ge=300, le=1e6)
    """Memory that one process may take; a window that needs more is given up."""


class ReportSettings(Model):
    """``[report]``: the work list, and when it is written by itself."""

    folder: Path | None = None
    """Folder for scheduled reports, relative to data_dir; none are written unless given."""
    weekday: Literal[
        "monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday", "daily"
    ] = "monday"
    """Day on which a report is written, or daily."""
    hour: int = Field(default=5, ge=0, le=23)
    """Hour (UTC) from which it is written; one that was missed is written later."""
    formats: tuple[Literal["html", "pdf", "csv", "xlsx"], ...] = Field(
        default=("html", "csv"), min_length=1
    )
    """Formats, one file each."""
    audience: Literal["technician", "engineer", "manager"] = "engineer"
    """Who reads it."""
    stick_band_limit: float = Field(default=5.0, gt=0, le=100)
    """Stick band, in % of OP's span, that maintenance should not let pass."""


class WebSettings(Model):
    """``[web]``: health, metrics and the operators' pages over HTTP."""

    enabled: bool = True
    """Whether the daemon answers HTTP at all."""
    host: str = "127.0.0.1"
    """Address to bind; other machines reach it only with a token and TLS."""
    port: int = Field(default=9480, ge=0, le=0xFFFF)
    """TCP port; 0 picks a free one."""
    token_file: Path | None = None
    """File with the token for looking and acting, relative to the site file."""
    tls_certificate: Path | None = None
    """Certificate chain (PEM), relative to the site file."""
    tls_key: Path | None = None
    """Private key (PEM) of the certificate, relative to the site file."""

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach it."""
        return is_loopback(self.host)

    @model_validator(mode="after")
    def _guarded(self) -> Self:
        if (self.tls_certificate is None) != (self.tls_key is None):
            raise ValueError("tls_certificate and tls_key belong together; give both or neither")
        guarded = self.token_file is not None and self.tls_certificate is not None
        if self.enabled and not self.is_local and not guarded:
            raise ValueError(
                f'host = "{self.host}" lets other machines in; add a token_file and a '
                "tls_certificate with its tls_key (without TLS the token can be read on the way), "
                'or bind to "127.0.0.1"'
            )
        return self
