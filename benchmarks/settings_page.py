"""The pages of the estimator's and the compensator's settings, written from their docstrings.

    python -m benchmarks.settings_page [--out docs]

Each class of `estimator.settings`, and each settings class of the compensator, is a section; each
entry of its docstring's ``Attributes`` is a row with the value that is shipped. A field without an
entry is an error.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from benchmarks.report import table
from compensator import HybridSettings, RetrySettings, SupervisorSettings, WatchSettings
from compensator.hybrid.load_trend import LoadTrendSettings
from compensator.hybrid.setpoint_trend import SetpointTrendSettings
from compensator.hybrid.thrift import ThriftSettings
from compensator.stem_tracking.friction import FrictionPrior
from compensator.stem_tracking.innovations import InnovationSettings
from compensator.stem_tracking.load_steps import LoadStepSettings
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import NOISE_KINDS
from compensator.supervising.cycles import CycleSettings
from compensator.supervising.figures import FiguresSettings
from compensator.supervising.harm import HarmSettings
from compensator.supervising.jumps import JumpSettings
from compensator.supervising.promise import PromiseSettings
from compensator.supervising.record_check import RecordCheckSettings
from estimator.settings import SETTINGS

__all__ = ["compensator_page", "entries_of", "main", "page"]

_HEAD = """# Settings of the estimator

Every number of the estimator that somebody chose, with its unit, its reason and its source.
No constant was chosen by recorded loops: where the source is "tuning family", the number was
chosen on the simulated loops of `benchmarks.families.tuning`, and the estimator is judged on
others (`benchmarks.families.report`). There are {count} of them. A nat is
one unit of the natural logarithm of a likelihood.

`identify(op, pv, settings=...)` takes other values; this page is written by
`python -m benchmarks.settings_page --out docs` from `estimator/settings.py`."""


_COMPENSATOR_HEAD = """# Settings of the compensator

What can be set of the compensator, with its reason: {count} settings. Where no source is named, a
number was chosen on simulated loops (of late those of `benchmarks.compensation_tuning`); the
compensator is judged on others (`benchmarks.compensation_apart`). Deviations are standard
deviations.

`Supervisor(base, settings)` takes other values; this page is written by
`python -m benchmarks.settings_page --out docs` from the docstrings of the package `compensator`."""

COMPENSATOR = (
    SupervisorSettings(),
    HybridSettings(),
    SetpointTrendSettings(),
    LoadTrendSettings(),
    ThriftSettings(),
    TrackerSettings(NOISE_KINDS[0]),
    FrictionPrior(),
    InnovationSettings(),
    LoadStepSettings(),
    JumpSettings(),
    RecordCheckSettings(),
    FiguresSettings(),
    WatchSettings(),
    CycleSettings(),
    HarmSettings(),
    PromiseSettings(),
    RetrySettings(),
)
"""What the compensator's page is made of."""


def entries_of(settings: object) -> Iterator[tuple[tuple[str, ...], str]]:
    """Names and text of every entry of a settings class's docstring, in order.

    An entry explains one field or several (``lanes, rounds: ...``); a second one may follow on the
    same line after a semicolon.

    Raises:
        ValueError: a field has no entry.
    """
    known = {field.name for field in fields(settings)}  # type: ignore[arg-type]
    _, _, listed = inspect.cleandoc(type(settings).__doc__ or "").partition("Attributes:")
    text = " ".join(listed.split())
    start = re.compile(r"(?:^|(?<=[.;]) )((?:\w+)(?:, \w+)*): ")
    heads = [m for m in start.finditer(text) if set(m.group(1).split(", ")) <= known]
    ends = [m.start() for m in heads[1:]] + [len(text)]
    found = [
        (tuple(m.group(1).split(", ")), text[m.end() : end].rstrip(" ;."))
        for m, end in zip(heads, ends, strict=True)
    ]
    missing = known - {name for names, _ in found for name in names}
    if missing:
        raise ValueError(
            f"{type(settings).__name__} has no sentence for {', '.join(sorted(missing))}: "
            f"add one to its docstring"
        )
    yield from found


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(_shown(part) for part in value)
    if is_dataclass(value):
        return f"see `{type(value).__name__}`"
    if value is None:
        return "none"
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


def page() -> str:
    """The estimator's page in Markdown."""
    groups = {group.name: getattr(SETTINGS, group.name) for group in fields(SETTINGS)}
    return _page(_HEAD, groups)


def compensator_page() -> str:
    """The compensator's page in Markdown."""
    return _page(_COMPENSATOR_HEAD, {type(found).__name__: found for found in COMPENSATOR})


def _page(head: str, groups: Mapping[str, Any]) -> str:
    parts, count = [], 0
    for name, settings in groups.items():
        count += len(fields(settings))
        summary = inspect.cleandoc(type(settings).__doc__ or "").partition("\n\nAttributes:")[0]
        rows = [
            (
                ", ".join(f"`{entry}`" for entry in entries),
                "; ".join(_shown(getattr(settings, entry)) for entry in entries),
                meaning,
            )
            for entries, meaning in entries_of(settings)
        ]
        parts += [f"## `{name}`", summary, table(("setting", "value", "meaning"), rows)]
    return "\n\n".join([head.format(count=count), *parts]).replace("``", "`") + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the page, or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for the pages")
    options = parser.parse_args(arguments)
    for name, text in (("settings", page()), ("compensator-settings", compensator_page())):
        if options.out is None:
            print(text, end="")
        else:
            (options.out / f"{name}.md").write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
