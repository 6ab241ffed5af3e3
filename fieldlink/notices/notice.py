"""What a notice says: one JSON object, and the same in words for a mail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from fieldlink.findings import describe_finding
from fieldlink.store import FindingRecord

__all__ = ["Notice", "device_notice", "finding_notice", "probe_notice", "summary_notice"]

MOST_LINES = 50
"""Notices that a summary lists; more are counted."""


@dataclass(frozen=True, slots=True)
class Notice:
    """One thing to tell people.

    Attributes:
        subject: what it is about, such as ``device/plc`` or ``finding/ID``.
        state: how that is now: confirmed, lost, back, test or summary.
        site: the site's name.
        title: one line.
        lines: the rest, a line each.
        link: the page that shows it.
        utc_ms: when it happened.
        detail: figures for programs.
    """

    subject: str
    state: str
    site: str
    title: str
    lines: tuple[str, ...]
    link: str
    utc_ms: int
    detail: Mapping[str, Any] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """The same for every attempt to deliver it."""
        return f"{self.subject}/{self.state}/{self.utc_ms}"

    @property
    def text(self) -> str:
        """All of it in words."""
        return "\n".join([f"{self.site}: {self.title}", *self.lines, "", self.link])

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object; ``text`` is what chat programs show of a web hook."""
        return {
            "id": self.id,
            "kind": self.subject.partition("/")[0],
            "state": self.state,
            "subject": self.subject,
            "site": self.site,
            "title": self.title,
            "text": self.text,
            "lines": list(self.lines),
            "link": self.link,
            "time": datetime.fromtimestamp(self.utc_ms / 1000.0, UTC).isoformat(),
            "detail": dict(self.detail),
            "utc_ms": self.utc_ms,
        }

    @classmethod
    def of_dict(cls, document: Mapping[str, Any]) -> Notice:
        """Return the notice that was kept on disk as ``document``."""
        return cls(
            document["subject"],
            document["state"],
            document["site"],
            document["title"],
            tuple(document["lines"]),
            document["link"],
            document["utc_ms"],
            document["detail"],
        )


def finding_notice(record: FindingRecord, site: str, page: str) -> Notice:
    """Return the notice of a confirmed finding."""
    # as the store has it: a number that is not finite has no word in JSON
    row: Mapping[str, Any] = record.row()
    document: Mapping[str, Any] = row["document"] or {}
    loop = record.loop
    lines = [*map(str, document.get("evidence", ()))]
    if action := document.get("action"):
        lines.append(f"next step: {action}")
    return Notice(
        subject=f"finding/{record.finding}",
        state=record.state,
        site=site,
        title=describe_finding(record),
        lines=tuple(lines),
        link=_page(page, f"loops/{quote(loop)}" if loop else ""),
        utc_ms=record.utc_ms,
        detail={
            "finding": record.finding,
            "cause": record.cause,
            "loop": record.loop or None,
            "loops": list(record.loops),
            "swing_period_s": row["swing_period_s"],
            "weight": row["weight"],
            "candidates": document.get("candidates", []),
        },
    )


def device_notice(
    device: str, state: str, reason: str, site: str, page: str, utc_ms: int
) -> Notice:
    """Return the notice of a device that is lost or back."""
    title = f"device {device} is lost" if state == "lost" else f"device {device} answers again"
    return Notice(
        f"device/{device}", state, site, title, (reason,) if reason else (),
        _page(page, "devices"), utc_ms, {"device": device},
    )  # fmt: skip


def summary_notice(held: Sequence[Notice], site: str, page: str, utc_ms: int) -> Notice:
    """Return one notice that stands for several that came too fast."""
    lines = [f"{one.title} ({one.state})" for one in held[:MOST_LINES]]
    if len(held) > MOST_LINES:
        lines.append(f"and {len(held) - MOST_LINES} more")
    return Notice(
        f"summary/{utc_ms}", "summary", site, f"{len(held)} more notices", tuple(lines),
        _page(page, ""), utc_ms, {"count": len(held)},
    )  # fmt: skip


def probe_notice(site: str, page: str, utc_ms: int) -> Notice:
    """Return a notice that only shows that notices arrive."""
    return Notice(
        f"test/{utc_ms}", "test", site, "a test of notices: nothing has happened",
        ("Sent by fieldlink notify test.",), _page(page, ""), utc_ms,
    )  # fmt: skip


def _page(base: str, path: str) -> str:
    return f"{base.rstrip('/')}/{path}"
