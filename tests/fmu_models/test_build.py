"""Building FMUs: valid, reproducible, current or not, and the message when it fails."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from fmpy.validation import validate_fmu

from fmu_models import PlantBuildError, catalogue, fmu_path, open_plant
from fmu_models import build as command
from fmu_models.compilers import PLATFORMS, compile_library, host_platform
from fmu_models.packing import build, build_source, is_current, model_names
from fmu_models.tables import SOURCES, read_model


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", model_names())
def test_fmpy_finds_nothing_to_say(name: str, version: int) -> None:
    assert validate_fmu(str(fmu_path(name, 2 if version == 2 else 3))) == []


def test_every_source_is_in_the_catalogue() -> None:
    assert set(model_names()) == set(catalogue)


def test_the_same_sources_give_the_same_file(tmp_path: Path) -> None:
    first, second = (build("level", output=tmp_path / folder) for folder in ("a", "b"))
    assert [path.name for path in first] == ["level.fmi2.fmu", "level.fmi3.fmu"]
    for a, b in zip(first, second, strict=True):
        with zipfile.ZipFile(a) as left, zipfile.ZipFile(b) as right:
            assert left.namelist() == right.namelist()
            same = [n for n in left.namelist() if not n.startswith("binaries/")]
            assert [left.read(n) for n in same] == [right.read(n) for n in same]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [p.name for p in first]


def test_the_sources_inside_are_all_that_a_compiler_needs(tmp_path: Path) -> None:
    with zipfile.ZipFile(fmu_path("heat")) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    library = tmp_path / f"again{host_platform().suffix}"
    compile_library(sources / "heat.c", (sources,), library, host_platform())
    with (
        zipfile.ZipFile(fmu_path("heat")) as archive,
        zipfile.ZipFile(tmp_path / "again.fmu", "w") as copy,
    ):
        for name in archive.namelist():
            ours = library.read_bytes() if name.startswith("binaries/") else archive.read(name)
            copy.writestr(name, ours)
    with open_plant(tmp_path / "again.fmu") as again, open_plant("heat") as first:
        inputs = [{"op": 60.0}] * 20
        assert again.steps(inputs) == first.steps(inputs)


def test_two_builds_at_once_do_no_harm(tmp_path: Path) -> None:
    arguments = [sys.executable, "-m", "fmu_models.build", "flow", "--force", "--output", tmp_path]
    builds = [subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    for process in builds:
        output, _ = process.communicate(timeout=300)
        assert process.returncode == 0
        assert "flow.fmi3.fmu" in output
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flow.fmi2.fmu", "flow.fmi3.fmu"]
    assert is_current(tmp_path / "flow.fmi3.fmu", "flow", 3)


def test_current_means_of_these_sources(tmp_path: Path) -> None:
    fmi2, fmi3 = build("level", output=tmp_path)
    assert is_current(fmi2, "level", 2)
    assert is_current(fmi3, "level", 3)
    assert not is_current(fmi3, "heat", 3)
    assert not is_current(tmp_path / "absent.fmu", "level", 3)
    fmi3.write_bytes(fmi3.read_bytes()[:100])
    assert not is_current(fmi3, "level", 3)


def test_command_builds_what_is_not_current(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["level", "--output", str(tmp_path)]) == 0
    assert "level.fmi2.fmu" in capsys.readouterr().out
    assert command.main(["level", "--output", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "level: current\n"
    assert command.main(["levle", "--output", str(tmp_path)]) == 1
    assert "there is no model 'levle'; there are: example1" in capsys.readouterr().err


def test_no_compiler_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("shutil.which", lambda _: None)
    monkeypatch.setattr("fmu_models.compilers.importlib.util.find_spec", _without_zig())
    with pytest.raises(PlantBuildError, match=r"no C compiler was found.*pip install ziglang"):
        build("level", output=tmp_path)
    assert list(tmp_path.iterdir()) == []


def _without_zig() -> object:
    import importlib.util

    real = importlib.util.find_spec
    return lambda name: None if name == "ziglang" else real(name)


def test_compiler_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "false")
    with pytest.raises(PlantBuildError, match=r"compiling level\.c .* failed \(exit status 1\)"):
        build("level", output=tmp_path)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(PlantBuildError, match="could not be run: no-such-compiler"):
        build("level", output=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_errors_of_the_compiler_are_shown(tmp_path: Path) -> None:
    source = tmp_path / "broken.c"
    text = (SOURCES / "level.c").read_text().replace("IDENTIFIER level", "IDENTIFIER broken")
    source.write_text(text.replace("p->memory.level = p->v.level_start;", "nonsense;"))
    with pytest.raises(PlantBuildError, match=r"compiling broken\.c(?s:.*)nonsense"):
        build_source(source, output=tmp_path)


def test_output_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(PlantBuildError, match=r"cannot write the FMU of level.*--output FOLDER"):
        build("level", output=tmp_path / "file")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("#define BASE_STEP 1.0\n", "", "#define BASE_STEP is missing"),
        ("X(load, input,", "X(load, imput,", "load: kind must be one of"),
        ('"%", "measured level"', '"furlong", "measured level"', "unit 'furlong' is not known"),
        ("200.0, 1.0, ANY", "(200.0,), 1.0, ANY", "a row of VARIABLES cannot be read"),
        ("VARIABLES(X)", "VARIABLE(X)", "no VARIABLES"),
    ],
)
def test_model_that_cannot_be_read(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = (SOURCES / "level.c").read_text()
    assert old in text
    source = tmp_path / "level.c"
    source.write_text(text.replace(old, new))
    with pytest.raises(PlantBuildError, match=words):
        build_source(source, output=tmp_path)


def test_description_comes_from_the_table() -> None:
    model = read_model(SOURCES / "heat.c")
    assert model.description.startswith("Temperature loop: a heat exchanger")
    dead_time = next(v for v in model.variables if v.name == "dead_time")
    assert (dead_time.kind, dead_time.type, dead_time.unit) == ("fixed", "Integer", "s")
    assert (dead_time.start, dead_time.low, dead_time.high) == (20.0, 0.0, 600.0)


@pytest.mark.slow
def test_zig_and_the_machines_compiler_give_the_same_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ziglang", reason="a second compiler: pip install ziglang")
    own = build("heat", output=tmp_path / "own")[-1]
    monkeypatch.setenv("CC", f"{sys.executable} -m ziglang cc")
    zig = build("heat", output=tmp_path / "zig")[-1]
    with open_plant(zig) as first, open_plant(own) as second:
        inputs = [{"op": 60.0 + k % 7} for k in range(200)]
        assert first.steps(inputs) == second.steps(inputs)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(
    "FIELDLINK_TEST_CROSS_BUILD" not in os.environ,
    reason="takes minutes when zig's cache is cold; set FIELDLINK_TEST_CROSS_BUILD=1",
)
def test_zig_builds_for_every_platform(tmp_path: Path) -> None:
    fmi2, fmi3 = build("level", platforms=PLATFORMS, output=tmp_path)
    magic = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}
    for path, expected in ((fmi2, 3), (fmi3, 5)):
        with zipfile.ZipFile(path) as archive:
            libraries = [n for n in archive.namelist() if n.startswith("binaries/")]
            assert len(libraries) == expected
            for name in libraries:
                assert archive.read(name).startswith(magic[Path(name).suffix])
    assert is_current(fmi3, "level", 3)
