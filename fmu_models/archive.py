"""Open an ``.fmu``: check the zip and the description before anything is extracted or run."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from .errors import PlantFileError

__all__ = [
    "KINDS",
    "extract_fmu",
    "has_sources",
    "kinds",
    "parse_description",
    "platforms",
    "read_description",
    "read_root",
]

CO_SIMULATION = "co-simulation"
MODEL_EXCHANGE = "model exchange"
KINDS = (CO_SIMULATION, MODEL_EXCHANGE)

MAX_EXTRACTED_BYTES = 1 << 30
"""More than this is taken for a zip bomb; the largest FMUs we know of extract to about 300 MB."""
MAX_ENTRIES = 20_000


def read_description(file: Path, kind: str | None = None) -> tuple[Any, str]:
    """Return FMPy's ``ModelDescription`` of an FMU that runs here, and the kind to run it as.

    Nothing of the FMU is run.

    Args:
        file: the ``.fmu``.
        kind: "co-simulation" or "model exchange"; None takes co-simulation where it is offered.

    Raises:
        PlantFileError: absent, not a zip, too large, no such model description, not offered in that
            kind, or no library for this platform.
    """
    description = parse_description(file)
    offered = kinds(description)
    chosen = kind or next((k for k in KINDS if k in offered), None)
    if chosen not in offered or chosen not in KINDS:
        raise PlantFileError(
            f"{file}: it does not offer {chosen or ' or '.join(KINDS)}, it offers "
            f"{', '.join(offered) or 'nothing'}; export it as a co-simulation FMU"
        )
    library = library_name(description, chosen)
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
    if library not in names:
        folder, _, wanted = library.rpartition("/")
        there = [n.rpartition("/")[2] for n in names if n.rpartition("/")[0] == folder]
        libraries = [n for n in there if n.endswith(fmpy.sharedLibraryExtension)]
        if libraries:
            raise PlantFileError(
                f"{file}: its description calls the library {wanted}, but {folder} has "
                f"{', '.join(libraries)}; export it again, or correct modelIdentifier"
            )
        found = ", ".join(platforms(names)) or "none"
        hint = "; it has sources: fmpy compile FILE builds it" if has_sources(names) else ""
        raise PlantFileError(
            f"{file}: it has no library for this platform ({library}); it offers {found}; export "
            f"it for this platform{hint}"
        )
    return description, chosen


def parse_description(file: Path) -> Any:
    """Return FMPy's ``ModelDescription`` of any FMU; nothing of the FMU is run.

    Raises:
        PlantFileError: absent, not a zip, too large, or no model description that can be read.
    """
    _check_archive(file)
    _check_version(file)
    try:
        description = fmpy.read_model_description(os.fspath(file), validate=False)
    except Exception as error:  # FMPy raises nothing narrower
        raise PlantFileError(
            f"{file}: its modelDescription.xml cannot be read ({error}); export it again"
        ) from error
    description.modelName = description.modelName or file.stem
    _drop_unusable_numbers(description.defaultExperiment)
    return description


def _drop_unusable_numbers(experiment: Any) -> None:
    """Take numbers of the default experiment that cannot be used for not given."""
    for name in ("startTime", "stopTime", "stepSize", "tolerance"):
        try:
            usable = math.isfinite(float(getattr(experiment, name, None) or 0.0))
        except ValueError:
            usable = False
        if name == "stepSize" and usable:
            usable = float(getattr(experiment, name, None) or 1.0) > 0.0
        if not usable:
            setattr(experiment, name, None)


def read_root(file: Path) -> Any:
    """Return the root element of a description: for what FMPy does not read of it.

    Raises:
        PlantFileError: it cannot be read.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    try:
        with zipfile.ZipFile(file) as archive:
            return etree.fromstring(archive.read("modelDescription.xml"), parser)
    except (zipfile.BadZipFile, etree.XMLSyntaxError, NotImplementedError, RuntimeError) as error:
        why = error.msg if isinstance(error, etree.XMLSyntaxError) else error
        raise PlantFileError(
            f"{file}: its modelDescription.xml cannot be read ({why}); export it again"
        ) from error


def _check_version(file: Path) -> None:
    """Check the root of the description and its FMI version, which FMPy does not check."""
    root = read_root(file)
    version = root.get("fmiVersion")
    if root.tag != "fmiModelDescription" or version is None:
        raise PlantFileError(
            f"{file}: its modelDescription.xml describes no FMU (it has no fmiModelDescription "
            "with an fmiVersion); export it again"
        )
    if not version.startswith(("1.", "2.", "3.")):
        raise PlantFileError(f"{file}: FMI {version} is not supported; export it as FMI 1, 2 or 3")


def kinds(description: Any) -> tuple[str, ...]:
    """Return what an FMU offers: co-simulation, model exchange, scheduled execution."""
    offers = {
        CO_SIMULATION: description.coSimulation,
        MODEL_EXCHANGE: description.modelExchange,
        "scheduled execution": description.scheduledExecution,
    }
    return tuple(name for name, interface in offers.items() if interface is not None)


def platforms(names: Iterable[str]) -> tuple[str, ...]:
    """Return the platforms that the entries of an FMU have libraries for, by its folders' names."""
    folders = (n.split("/") for n in names if n.startswith("binaries/"))
    return tuple(sorted({parts[1] for parts in folders if len(parts) > 2 and parts[2]}))


def has_sources(names: Iterable[str]) -> bool:
    """Whether an FMU carries C sources."""
    return any(n.startswith("sources/") and n.endswith((".c", ".cpp")) for n in names)


def library_name(description: Any, kind: str) -> str:
    """Return the path of this platform's library inside the FMU."""
    folder = fmpy.platform_tuple if description.fmiVersion.startswith("3.") else fmpy.platform
    interface = description.modelExchange if kind == MODEL_EXCHANGE else description.coSimulation
    return f"binaries/{folder}/{interface.modelIdentifier}{fmpy.sharedLibraryExtension}"


def extract_fmu(file: Path, folder: Path) -> None:
    """Extract ``file`` into ``folder``.

    Raises:
        PlantFileError: a damaged archive or an entry that leads out of it.
    """
    try:
        fmpy.extract(os.fspath(file), os.fspath(folder))
    except Exception as error:  # FMPy raises nothing narrower
        raise PlantFileError(f"{file}: it cannot be extracted: {error}") from error


def _check_archive(file: Path) -> None:
    if os.path.isdir(file):
        raise PlantFileError(f"{file}: it is a folder; an FMU is a zip file, so zip its contents")
    if os.path.exists(file) and not os.path.isfile(file):
        raise PlantFileError(f"{file}: it is a pipe or a device; give a file")
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
    except FileNotFoundError as error:
        raise PlantFileError(f"{file}: there is no such file; check the path") from error
    except PermissionError as error:
        raise PlantFileError(
            f"{file}: it cannot be read ({error.strerror}); check its permissions"
        ) from error
    except (zipfile.BadZipFile, OSError) as error:
        raise PlantFileError(
            f"{file}: it is not an FMU (an FMU is a zip file): {error}; copy or export it again"
        ) from error
    size = sum(entry.file_size for entry in entries)
    if size > MAX_EXTRACTED_BYTES or len(entries) > MAX_ENTRIES:
        raise PlantFileError(
            f"{file}: it would extract to {size / 2**20:.0f} MB in {len(entries)} files; the limit "
            f"is {MAX_EXTRACTED_BYTES / 2**20:.0f} MB in {MAX_ENTRIES} files"
        )
    names = {entry.filename for entry in entries}
    if "modelDescription.xml" not in names:
        deeper = min((n for n in names if n.endswith("/modelDescription.xml")), default=None)
        hint = (
            "; export it again"
            if deeper is None
            else f"; there is {deeper}: zip what is in the folder, without the folder itself"
        )
        raise PlantFileError(
            f"{file}: it is a zip file without modelDescription.xml: not an FMU{hint}"
        )
