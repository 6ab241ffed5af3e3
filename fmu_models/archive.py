"""Open an ``.fmu`` with suspicion: check the zip, read the description, extract."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import fmpy

from .errors import PlantFileError

__all__ = ["extract_fmu", "read_description"]

MAX_EXTRACTED_BYTES = 1 << 30
"""More than this is taken for a zip bomb; the largest FMUs we know of extract to about 300 MB."""
MAX_ENTRIES = 20_000


def read_description(file: Path) -> Any:
    """Return FMPy's ``ModelDescription`` of a co-simulation FMU of FMI 2 or 3 that runs here.

    Nothing of the FMU is run.

    Raises:
        PlantFileError: absent, not a zip, too large, no such model description, no co-simulation,
            or no library for this platform.
    """
    _check_archive(file)
    try:
        description = fmpy.read_model_description(os.fspath(file), validate=False)
    except Exception as error:  # FMPy raises nothing narrower
        raise PlantFileError(f"{file}: its modelDescription.xml cannot be read: {error}") from error
    if not description.fmiVersion.startswith(("2.", "3.")):
        raise PlantFileError(
            f"{file}: FMI {description.fmiVersion} is not supported; export it as FMI 2 or 3"
        )
    if description.coSimulation is None:
        raise PlantFileError(
            f"{file}: it offers no co-simulation; export it as a co-simulation FMU, "
            "with its solver inside"
        )
    library = library_name(description)
    with zipfile.ZipFile(file) as archive:
        names = set(archive.namelist())
    if library not in names:
        offered = sorted({n.split("/")[1] for n in names if n.startswith("binaries/")} - {""})
        raise PlantFileError(
            f"{file}: it has no library for this platform ({library}); it offers "
            f"{', '.join(offered) or 'none'}; export it for this platform"
        )
    return description


def library_name(description: Any) -> str:
    """Return the path of this platform's library inside the FMU."""
    folder = fmpy.platform if description.fmiVersion.startswith("2.") else fmpy.platform_tuple
    identifier = description.coSimulation.modelIdentifier
    return f"binaries/{folder}/{identifier}{fmpy.sharedLibraryExtension}"


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
    if not file.is_file():
        raise PlantFileError(f"{file}: there is no such file")
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, OSError) as error:
        raise PlantFileError(f"{file}: it is not an FMU (an FMU is a zip file): {error}") from error
    size = sum(entry.file_size for entry in entries)
    if size > MAX_EXTRACTED_BYTES or len(entries) > MAX_ENTRIES:
        raise PlantFileError(
            f"{file}: it would extract to {size / 2**20:.0f} MB in {len(entries)} files; the limit "
            f"is {MAX_EXTRACTED_BYTES / 2**20:.0f} MB in {MAX_ENTRIES} files"
        )
    if "modelDescription.xml" not in {entry.filename for entry in entries}:
        raise PlantFileError(f"{file}: it is a zip file without modelDescription.xml: not an FMU")
