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
from .describe import FmiVersion, describe
from .errors import PlantBuildError
from .tables import SOURCES, ModelSource, own_files, read_model

__all__ = [
    "BINARIES",
    "FMI_VERSIONS",
    "SOURCES",
    "build",
    "build_source",
    "is_current",
    "model_names",
    "target_file",
]

BINARIES = Path(__file__).with_name("binaries")

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
    return token == _token(SOURCES / f"{name}.c") and any(
        n.startswith(f"binaries/{folder}/") for n in names
    )


def build(
    name: str, *, platforms: tuple[Platform, ...] | None = None, output: Path = BINARIES
) -> tuple[Path, ...]:
    """Build the FMUs of a model that has its source here; see `build_source`."""
    if name not in model_names():
        raise PlantBuildError(f"there is no model {name!r}; there are: {', '.join(model_names())}")
    return build_source(SOURCES / f"{name}.c", platforms=platforms, output=output)


def build_source(
    source: Path, *, platforms: tuple[Platform, ...] | None = None, output: Path
) -> tuple[Path, ...]:
    """Build the FMUs of a model's C file, FMI 2 and FMI 3, into ``output``; return their paths.

    The file may include its neighbours and our headers. An FMU appears under its name only when it
    is complete, so two builds at once do no harm. Where FMI 2 has no folder for any of the
    platforms, only FMI 3 is built.

    Args:
        source: a model in the form of ``plant.h``, called as its MODEL_IDENTIFIER says.
        platforms: None means this machine's.
        output: folder of the ``.fmu`` files; it is made.

    Raises:
        PlantBuildError: no such file, not in that form, no compiler, compiler's complaints, or
            ``output`` cannot be written.
    """
    if not os.path.isfile(source):
        raise PlantBuildError(f"{source}: there is no such C file")
    chosen = platforms or (host_platform(),)
    model = read_model(source)
    if model.name != source.stem:
        raise PlantBuildError(f"{source}: MODEL_IDENTIFIER is {model.name}; call the file like it")
    try:
        output.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".build-", dir=output) as folder:
            return _build_in(Path(folder), model, chosen, output)
    except OSError as error:
        raise PlantBuildError(
            f"cannot write the FMU of {model.name} below {output}: {error}; build into a folder of "
            "your own: python -m fmu_models.build --output FOLDER"
        ) from error


def _build_in(
    work: Path, model: ModelSource, platforms: tuple[Platform, ...], output: Path
) -> tuple[Path, ...]:
    token = _token(model.file)
    (work / "token.h").write_text(f'#define FMU_TOKEN "{token}"\n', encoding="ascii")
    libraries: dict[Platform, Path] = {}
    for platform in platforms:
        library = work / f"{platform.fmi3}{platform.suffix}"
        compile_library(
            model.file, (model.file.parent, work, SOURCES, _header_folder()), library, platform
        )
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
    for source in _inputs(model.file):
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


def _inputs(source: Path) -> tuple[Path, ...]:
    """Return the files that the FMU of a model is compiled from, the FMI headers among them."""
    own = own_files(source)
    headers = _header_folder()
    pending = [headers / name for name in ("fmi2Functions.h", "fmi3Functions.h")]
    found: set[Path] = set()
    while pending:
        file = pending.pop()
        found.add(file)
        pending += [
            headers / name
            for name in re.findall(r'^#include "(fmi[^"]+)"', file.read_text("utf-8"), re.MULTILINE)
            if headers / name not in found
        ]
    return tuple(sorted({*own, *found}))


@functools.cache
def _token(source: Path) -> str:
    """Return the digest of everything but the FMI headers that the FMU of a model is made from."""
    digest = hashlib.sha256()
    makers = (Path(__file__).with_name(name) for name in ("describe.py", "tables.py"))
    for file in (*own_files(source), *makers):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"
