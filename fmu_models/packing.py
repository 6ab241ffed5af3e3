"""From a model's source to its ``.fmu`` files.

An ``.fmu`` is a zip of ``modelDescription.xml``, a shared library a platform and the sources, so
that any importer can compile it again. One library serves FMI 2 and FMI 3. The token that ties the
description to the library is a digest of our sources: a file with another token is stale.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import re
import tempfile
import zipfile
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree as ET

from .compilers import Platform, compile_library, host_platform
from .describe import FmiVersion, ModelSource, describe, read_model
from .errors import PlantBuildError

__all__ = [
    "BINARIES",
    "FMI_VERSIONS",
    "SOURCES",
    "build",
    "is_current",
    "model_names",
    "target_file",
]

SOURCES = Path(__file__).with_name("sources")
BINARIES = Path(__file__).with_name("binaries")

_FMI_HEADERS = (
    "fmi2Functions.h",
    "fmi2FunctionTypes.h",
    "fmi2TypesPlatform.h",
    "fmi3Functions.h",
    "fmi3FunctionTypes.h",
    "fmi3PlatformTypes.h",
)
FMI_VERSIONS: tuple[FmiVersion, ...] = get_args(FmiVersion)
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the same bytes from the same sources


@functools.cache
def model_names() -> tuple[str, ...]:
    """Return the names of the models that have a source here."""
    return tuple(sorted(file.stem for file in SOURCES.glob("*.c")))


def target_file(name: str, version: FmiVersion) -> Path:
    """Return where the FMU of a model stands once it is built."""
    return BINARIES / f"{name}.fmi{version}.fmu"


def is_current(file: Path, name: str, version: FmiVersion) -> bool:
    """Whether ``file`` is an FMU of the present sources with a library for this platform."""
    if not file.is_file():
        return False
    folder = host_platform().folder(version)
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
            root = ET.fromstring(archive.read("modelDescription.xml"))
    except (zipfile.BadZipFile, KeyError, ET.ParseError):
        return False
    token = root.get("guid" if version == 2 else "instantiationToken")
    return token == _token(name) and any(n.startswith(f"binaries/{folder}/") for n in names)


def build(
    name: str, *, platforms: tuple[Platform, ...] | None = None, output: Path = BINARIES
) -> tuple[Path, ...]:
    """Build the FMUs of one model, FMI 2 and FMI 3, and return their paths.

    A file appears under its name only when it is complete, so two builds at once do no harm.
    Where FMI 2 has no folder for any of the platforms, only FMI 3 is built.

    Raises:
        PlantBuildError: unknown model, no compiler, or ``output`` cannot be written.
    """
    if name not in model_names():
        raise PlantBuildError(f"there is no model {name!r}; there are: {', '.join(model_names())}")
    chosen = platforms or (host_platform(),)
    model = read_model(SOURCES / f"{name}.c")
    token = _token(name)
    try:
        output.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".build-", dir=output) as folder:
            return _build_in(Path(folder), model, token, chosen, output)
    except OSError as error:
        raise PlantBuildError(
            f"cannot write the FMU of {name} below {output}: {error}; build into a folder of your "
            "own: python -m fmu_models.build --output FOLDER"
        ) from error


def _build_in(
    work: Path, model: ModelSource, token: str, platforms: tuple[Platform, ...], output: Path
) -> tuple[Path, ...]:
    (work / "token.h").write_text(f'#define FMU_TOKEN "{token}"\n', encoding="ascii")
    libraries: dict[Platform, Path] = {}
    for platform in platforms:
        library = work / f"{platform.fmi3}{platform.suffix}"
        compile_library(model.file, (work, SOURCES, _header_folder()), library, platform)
        libraries[platform] = library
    built = []
    for version in FMI_VERSIONS:
        if all(platform.folder(version) is None for platform in platforms):
            continue
        draft = work / f"fmi{version}.fmu"
        _pack(draft, model, version, token, libraries)
        target = output / target_file(model.name, version).name
        os.replace(draft, target)
        built.append(target)
    return tuple(built)


def _pack(
    file: Path,
    model: ModelSource,
    version: FmiVersion,
    token: str,
    libraries: dict[Platform, Path],
) -> None:
    entries = {"modelDescription.xml": describe(model, version, token)}
    for platform, library in libraries.items():
        folder = platform.folder(version)
        if folder is not None:
            entries[f"binaries/{folder}/{model.name}{platform.suffix}"] = library.read_bytes()
    for source in _inputs(model.name):
        entries[f"sources/{source.name}"] = source.read_bytes()
    entries["sources/token.h"] = f'#define FMU_TOKEN "{token}"\n'.encode()
    if version == 3:
        entries["sources/buildDescription.xml"] = _build_description(model)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(zipfile.ZipInfo(name, _ZIP_TIME), content, zipfile.ZIP_DEFLATED)


def _build_description(model: ModelSource) -> bytes:
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.name)
    files = ET.SubElement(configuration, "SourceFileSet", language="C11")
    ET.SubElement(files, "SourceFile", name=model.file.name)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _header_folder() -> Path:
    """Return the folder of the FMI headers, which FMPy ships (2-clause BSD)."""
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise PlantBuildError("the FMI headers come with FMPy, which is not installed")
    return Path(spec.origin).with_name("c-code")


@functools.cache
def _inputs(name: str) -> tuple[Path, ...]:
    """Return the files that the FMU of a model is compiled from: those its includes lead to."""
    pending = [SOURCES / f"{name}.c"]
    found: list[Path] = []
    while pending:
        file = pending.pop(0)
        if file in found:
            continue
        found.append(file)
        for include in re.findall(r'^\s*#include "([^"]+)"', file.read_text("utf-8"), re.MULTILINE):
            if include == "token.h":
                continue
            own = SOURCES / include
            pending.append(own if own.is_file() else _header_folder() / include)
    headers = {_header_folder() / header for header in _FMI_HEADERS}
    return tuple(sorted({*found, *headers}))


@functools.cache
def _token(name: str) -> str:
    """Return the digest of all of ours that the FMU of a model is made from."""
    digest = hashlib.sha256()
    own = [file for file in _inputs(name) if file.parent == SOURCES]
    for file in (*own, Path(__file__).with_name("describe.py")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"
