"""What an assessment is to do, in plain types: it crosses processes and machines as JSON."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["RECORD", "RUN_FILE", "Columns", "Cut", "Job", "Judging", "Piece", "Place"]

RUN_FILE, RECORD = "run.sqlite", "run.json"
"""In the folder of a run that is not finished, and of one that is."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where loops are recorded, as the user named it.

    Attributes:
        kind: the name of its reader.
        where: absolute path or database address; a password in it is never shown or stored.
        shown: for people and for the column ``file``.
    """

    kind: str
    where: str
    shown: str


@dataclass(frozen=True, slots=True)
class Columns:
    """Names of columns in files, None for the role's own name; ``period`` in seconds."""

    op: str | None = None
    pv: str | None = None
    sp: str | None = None
    auto: str | None = None
    time: str | None = None
    period: float | None = None

    def names(self) -> dict[str, str | None]:
        """The column of each role."""
        return {"op": self.op, "pv": self.pv, "sp": self.sp, "auto": self.auto, "time": self.time}


@dataclass(frozen=True, slots=True)
class Cut:
    """How recordings are cut into windows.

    Attributes:
        since, until: first moment and the moment after the last one, seconds since 1970.
        every: seconds between the beginnings of windows; None lets them follow each other.
        samples: of a window, at most (without ``every`` half as many again for the last one).
    """

    since: float | None = None
    until: float | None = None
    every: float | None = None
    samples: int = 1000


@dataclass(frozen=True, slots=True)
class Judging:
    """How a window is judged, see `estimator.identify`, and what a worker may use.

    Attributes:
        criterion, confidence: of the estimator.
        limit: processor seconds of one window. A window of the default length takes about one.
        memory: bytes of data that a worker may hold; the estimator needs a tenth of it.
    """

    criterion: str = "auto"
    confidence: float = 0.9
    limit: float = 300.0
    memory: int = 2_000_000_000


@dataclass(frozen=True, slots=True)
class Job:
    """One assessment.

    Attributes:
        places: what is read.
        columns, cut, judging: how.
        sources: hash of the numeric sources; workers of another release are refused.
    """

    places: tuple[Place, ...]
    columns: Columns = field(default_factory=Columns)
    cut: Cut = field(default_factory=Cut)
    judging: Judging = field(default_factory=Judging)
    sources: str = ""

    def to_json(self) -> str:
        """One line, with the addresses as they are: for a worker, not for a disk."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Job:
        """Read what `to_json` wrote."""
        plain = json.loads(text)
        return cls(
            places=tuple(Place(**place) for place in plain["places"]),
            columns=Columns(**plain["columns"]),
            cut=Cut(**plain["cut"]),
            judging=Judging(**plain["judging"]),
            sources=plain["sources"],
        )

    def options(self) -> dict[str, Any]:
        """Return the options by which two runs are the same; no password is among them."""
        return {
            "places": [place.shown for place in self.places],
            "columns": asdict(self.columns),
            "cut": asdict(self.cut),
            "criterion": self.judging.criterion,
            "confidence": self.judging.confidence,
            "sources": self.sources,
        }

    def fingerprint(self) -> str:
        """Names this job in a process that serves several."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Piece:
    """What a worker reads at a time: a file, or one loop over some windows.

    Attributes:
        place: index into the job's places.
        file: the file or address for the row; for a folder, the file inside it.
        path: what is opened, empty where the place itself is.
        loop: the loop's name; empty where the file decides.
        since, until: this piece's part of the time, seconds as the place counts them; None for all.
    """

    place: int
    file: str
    path: str = ""
    loop: str = ""
    since: float | None = None
    until: float | None = None

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> Piece:
        """From JSON."""
        return cls(**plain)
