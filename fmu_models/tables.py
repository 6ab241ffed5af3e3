"""The table of variables of a model's C file: the single source of what the FMU shows.

The C compiler expands the rows of ``VARIABLES(X)`` into the model's variables; `read_model` reads
the same rows. A header may bring rows of its own, ``#define SOME_VARIABLES(X)``, that the model's
table names; a ``#define`` of the model may stand for a number or a unit in them.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path

from .errors import PlantBuildError

__all__ = ["SOURCES", "UNITS", "ModelSource", "Variable", "own_files", "read_model"]

SOURCES = Path(__file__).with_name("sources")

_KINDS = ("input", "output", "fixed", "tunable")
_TYPES = ("Real", "Integer")
_ROW = re.compile(
    r"X\(\s*(?P<name>\w+),\s*(?P<kind>\w+),\s*(?P<type>\w+),\s*(?P<start>[^,]+),\s*(?P<low>[^,]+),"
    r'\s*(?P<high>[^,]+),\s*"(?P<unit>[^"]*)",\s*"(?P<text>[^"]*)"\s*\)'
)
# Exponents of the SI base units and the factor to them; all the units of the catalogue.
UNITS: dict[str, dict[str, str]] = {
    "%": {"factor": "0.01"},
    "1": {},
    "s": {"s": "1"},
    "m": {"m": "1"},
    "m3/h": {"m": "3", "s": "-1", "factor": repr(1 / 3600)},
    "bar": {"kg": "1", "m": "-1", "s": "-2", "factor": "1e5"},
    "kPa": {"kg": "1", "m": "-1", "s": "-2", "factor": "1e3"},
    "degC": {"K": "1", "offset": "273.15"},
    "K": {"K": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N/m": {"kg": "1", "s": "-2"},
    "N.s/m": {"kg": "1", "s": "-1"},
    "kg": {"kg": "1"},
    "m/s": {"m": "1", "s": "-1"},
    "m2": {"m": "2"},
    "cm": {"m": "1", "factor": "0.01"},
    "ml": {"m": "3", "factor": "1e-6"},
    "ml/s": {"m": "3", "s": "-1", "factor": "1e-6"},
}


@dataclass(frozen=True, slots=True)
class Variable:
    """A row of a model's table; ``low`` and ``high`` are infinite where there is no bound."""

    name: str
    kind: str
    type: str
    start: float
    low: float
    high: float
    unit: str
    text: str


@dataclass(frozen=True, slots=True)
class ModelSource:
    """What the build reads out of a model's C file."""

    name: str
    file: Path
    description: str
    base_step: float
    default_step: float
    variables: tuple[Variable, ...]


def read_model(file: Path) -> ModelSource:
    """Read the defines and the table of variables of a model's C file.

    Raises:
        PlantBuildError: the file lacks one of them, or a row cannot be read.
    """
    text = file.read_text(encoding="utf-8")
    comment = re.match(r"/\*(.*?)\*/", text, re.DOTALL)
    table = _table(text, "VARIABLES")
    if comment is None or table is None:
        raise PlantBuildError(f"{file.name}: no comment at the top, or no VARIABLES(X) table")
    rows = _with_defines(_with_shared_rows(table, file), text)
    variables = tuple(_variable(file, match) for match in _ROW.finditer(rows))
    if not variables or len(variables) != len(re.findall(r"\bX\(", rows)):
        raise PlantBuildError(
            f"{file.name}: a row of VARIABLES cannot be read; the form is "
            'X(name, kind, type, start, low, high, "unit", "text"), without commas in the numbers'
        )
    first_paragraph = re.split(r"\n \*\s*\n", comment.group(1))[0]
    return ModelSource(
        name=_define(text, "MODEL_IDENTIFIER", file),
        file=file,
        description=" ".join(first_paragraph.replace("\n *", " ").split()),
        base_step=float(_define(text, "BASE_STEP", file)),
        default_step=float(_define(text, "DEFAULT_STEP", file)),
        variables=variables,
    )


def _table(text: str, name: str) -> str | None:
    match = re.search(rf"#define {name}\(X\)((?:.*\\\n)*.*)", text)
    return None if match is None else match.group(1).replace("\\\n", " ")


def _with_shared_rows(rows: str, file: Path) -> str:
    """Put the rows of a header where the table names them."""

    def rows_of(match: re.Match[str]) -> str:
        for header in own_files(file):
            found = _table(header.read_text(encoding="utf-8"), match[1])
            if found is not None:
                return found
        raise PlantBuildError(
            f"{file.name}: no file that it includes has the rows {match[1]}(X); include the header"
        )

    return re.sub(r"\b(\w+_VARIABLES)\(X\)", rows_of, rows)


def _with_defines(rows: str, text: str) -> str:
    """Put the model's own numbers and units where the rows name them."""
    for name, value in re.findall(r"^#define (\w+) (\S+)$", text, re.MULTILINE):
        rows = re.sub(rf"\b{name}\b", value.replace("\\", r"\\"), rows)
    return rows


@functools.cache
def own_files(source: Path) -> tuple[Path, ...]:
    """Return a model's C file and the files beside it and of ours that its includes lead to."""
    pending, found = [source], set[Path]()
    while pending:
        file = pending.pop()
        found.add(file)
        for include in re.findall(r'^\s*#include "([^"]+)"', file.read_text("utf-8"), re.MULTILINE):
            candidates = (folder / include for folder in (source.parent, SOURCES))
            header = next((c for c in candidates if c.is_file()), None)
            if header is not None and header not in found:
                pending.append(header)
    return tuple(sorted(found))


def _define(text: str, name: str, file: Path) -> str:
    match = re.search(rf"^#define {name} (\S+)$", text, re.MULTILINE)
    if match is None:
        raise PlantBuildError(f"{file.name}: #define {name} is missing")
    return match.group(1)


def _variable(file: Path, match: re.Match[str]) -> Variable:
    if match["kind"] not in _KINDS or match["type"] not in _TYPES:
        raise PlantBuildError(
            f"{file.name}: {match['name']}: kind must be one of {_KINDS} and type one of {_TYPES}; "
            f"got {match['kind']}, {match['type']}"
        )
    if match["unit"] and match["unit"] not in UNITS:
        raise PlantBuildError(
            f"{file.name}: {match['name']}: unit {match['unit']!r} is not known; add it to "
            "the units of fmu_models/tables.py"
        )
    start, low, high = (_number(match[key]) for key in ("start", "low", "high"))
    return Variable(
        match["name"], match["kind"], match["type"], start, low, high, match["unit"], match["text"]
    )


def _number(text: str) -> float:
    return float(text.strip().replace("ANY", "inf"))
