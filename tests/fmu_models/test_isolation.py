"""FMUs that crash, hang or are damaged: a clear error, the others go on, nothing is left behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from fmu_models import (
    PlantClosedError,
    PlantCrashError,
    PlantFileError,
    PlantStepError,
    PlantTimeoutError,
    archive,
    fmu_path,
    open_plant,
)

Alter = Callable[[Path, Callable[[str, bytes], bytes | None]], Path]
ABORT, SEGFAULT, ENDLESS, REFUSE, NAN = 1, 2, 3, 4, 5

linux_only = pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks processes up in /proc")


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("fault", "name"), [(ABORT, "SIGABRT"), (SEGFAULT, "SIGSEGV")])
def test_crash_in_a_step(
    faulty_fmus: tuple[Path, Path], version: int, fault: int, name: str
) -> None:
    file = faulty_fmus[version - 2]
    with open_plant(file) as bad, open_plant(file) as good:
        assert bad.step({"op": 60.0}) == {"pv": 60.0, "steps": 1.0}
        with pytest.raises(
            PlantCrashError, match=rf"faulty.*at 1 s: in a step its process died of {name}"
        ):
            bad.step({"fault": fault})
        with pytest.raises(PlantClosedError, match=rf"failed before.*{name}"):
            bad.step({"op": 60.0})
        assert good.step({"op": 61.0}) == {"pv": 61.0, "steps": 1.0}


def test_crash_inside_a_batch(faulty: Path) -> None:
    with open_plant(faulty) as plant, pytest.raises(PlantCrashError, match="SIGSEGV"):
        plant.steps([{}] * 500 + [{"fault": SEGFAULT}] + [{}] * 500)


def test_crash_at_the_start(faulty: Path) -> None:
    with pytest.raises(PlantCrashError, match=r"SIGABRT.*truncated or damaged"):
        open_plant(faulty, parameters={"fault": ABORT, "at_start": 1})


def test_endless_step_is_ended(faulty: Path) -> None:
    with open_plant(faulty) as plant:
        plant._link.timeout = 0.5
        with pytest.raises(PlantTimeoutError, match=r"in a step it did not answer for 0\.5 s"):
            plant.step({"fault": ENDLESS})
        with pytest.raises(PlantClosedError, match="endless loop"):
            plant.outputs()


def test_endless_start_is_ended(faulty: Path) -> None:
    with pytest.raises(PlantTimeoutError, match="while it started it did not answer"):
        open_plant(faulty, parameters={"fault": ENDLESS, "at_start": 1}, timeout=0.5)


@pytest.mark.parametrize("isolated", [True, False])
def test_refusal_carries_the_fmus_words(faulty: Path, isolated: bool) -> None:
    with (
        open_plant(faulty, isolated=isolated) as plant,
        pytest.raises(PlantStepError, match=r"step from 0 s by 1 s failed.*this plant refuses"),
    ):
        plant.step({"fault": REFUSE})
    with pytest.raises(PlantStepError, match=r"refused to start.*this plant refuses"):
        open_plant(faulty, parameters={"fault": REFUSE, "at_start": 1}, isolated=isolated)


def test_our_wrapper_refuses_to_put_out_nan(faulty: Path) -> None:
    with open_plant(faulty) as plant, pytest.raises(PlantStepError, match="pv is no finite number"):
        plant.step({"fault": NAN})


def test_truncated_library(altered: Alter) -> None:
    def halve(name: str, content: bytes) -> bytes:
        return content[: len(content) // 2] if name.startswith("binaries/") else content

    with pytest.raises((PlantCrashError, PlantFileError), match="damaged"):
        open_plant(altered(fmu_path("example1"), halve))


@pytest.mark.parametrize("isolated", [True, False])
def test_library_that_is_no_library(altered: Alter, isolated: bool) -> None:
    folder = Path.cwd()

    def replace(name: str, content: bytes) -> bytes:
        return b"not a library" if name.startswith("binaries/") else content

    with pytest.raises(PlantFileError, match=r"library cannot be loaded.*damaged"):
        open_plant(altered(fmu_path("example1"), replace), isolated=isolated)
    assert Path.cwd() == folder


@pytest.mark.parametrize("isolated", [True, False])
def test_library_of_another_model(altered: Alter, isolated: bool) -> None:
    with zipfile.ZipFile(fmu_path("example2")) as other:
        libraries = [n for n in other.namelist() if n.startswith("binaries/")]
        foreign = other.read(libraries[0])

    def swap(name: str, content: bytes) -> bytes:
        return foreign if name.startswith("binaries/") else content

    with pytest.raises(PlantFileError, match=r"refused to be instantiated: .*is not that of this"):
        open_plant(altered(fmu_path("example1"), swap), isolated=isolated)


@pytest.mark.parametrize("isolated", [True, False])
def test_a_library_of_another_build_is_told_with_the_remedy(
    faulty: Path, altered: Alter, isolated: bool
) -> None:
    def exchange(pattern: bytes, by: bytes) -> Callable[[str, bytes], bytes]:
        return lambda name, content: (
            re.sub(pattern, by, content) if name == "modelDescription.xml" else content
        )

    other_token = exchange(rb'(guid|instantiationToken)="[^"]*"', rb'\1="{dead}"')
    with pytest.raises(PlantFileError, match=r"of two builds, so export the FMU again as a whole"):
        open_plant(altered(faulty, other_token), isolated=isolated)
    # PV is the library's third variable.
    lacking = exchange(rb'valueReference="2"', rb'valueReference="903"')
    with pytest.raises(PlantStepError, match=r"does not give its outputs \(pv, steps.*: export"):
        open_plant(altered(faulty, lacking), isolated=isolated)


def test_no_library_for_this_platform(altered: Alter) -> None:
    file = altered(fmu_path("example1"), lambda n, c: None if n.startswith("binaries/") else c)
    with pytest.raises(PlantFileError, match=r"no library for this platform .*it offers none"):
        open_plant(file)


@pytest.mark.parametrize("isolated", [True, False])
def test_library_that_lacks_functions(altered: Alter, isolated: bool) -> None:
    """It says that it offers model exchange, and has none of its functions."""

    def change(name: str, content: bytes) -> bytes:
        return (
            content.replace(b"CoSimulation", b"ModelExchange") if name.endswith("xml") else content
        )

    with pytest.raises(PlantFileError, match=r"library cannot be loaded.*fmi2\w+.*incomplete"):
        open_plant(altered(fmu_path("example1", 2), change), isolated=isolated)


def test_kind_that_is_not_offered() -> None:
    with pytest.raises(PlantFileError, match="does not offer model exchange, it offers co-simul"):
        open_plant("example1", kind="model exchange")


def test_description_that_is_no_xml(altered: Alter) -> None:
    file = altered(fmu_path("example1"), lambda n, c: c[:200] if n.endswith(".xml") else c)
    with pytest.raises(PlantFileError, match=r"modelDescription\.xml cannot be read"):
        open_plant(file)


@pytest.mark.parametrize("isolated", [True, False])
def test_files_that_are_no_fmus(tmp_path: Path, isolated: bool) -> None:
    text, empty, archive_only = (tmp_path / f"{n}.fmu" for n in ("text", "empty", "archive"))
    text.write_text("hello")
    empty.touch()
    with zipfile.ZipFile(archive_only, "w") as file:
        file.writestr("readme.txt", "hello")
    for path, words in (
        (tmp_path / "absent.fmu", "there is no such file"),
        (text, "is not an FMU"),
        (empty, "is not an FMU"),
        (archive_only, r"without modelDescription\.xml"),
        (tmp_path, "it is a folder"),
    ):
        with pytest.raises(PlantFileError, match=words) as caught:
            open_plant(path, isolated=isolated)
        remedy = str(caught.value).rpartition("; ")[2]
        assert remedy.startswith(("check the path", "copy or export it", "export it", "an FMU is"))


def test_zip_bomb(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_EXTRACTED_BYTES", 100_000)
    with pytest.raises(PlantFileError, match=r"would extract to 0 MB in \d+ files; the limit"):
        open_plant(fmu_path("example1"), isolated=False)


def test_entry_that_leads_out_of_the_archive(tmp_path: Path) -> None:
    file = tmp_path / "path.fmu"
    file.write_bytes(fmu_path("example1").read_bytes())
    with zipfile.ZipFile(file, "a") as writer:
        writer.writestr("/etc/evil", "x")
    with pytest.raises(PlantFileError, match="cannot be extracted: Illegal path"):
        open_plant(file)


_NOTHING_LEFT = """
import os, sys, tempfile
from fmu_models import PlantError, fmu_path, open_plant
bad, text = sys.argv[1:]
for isolated in (True, False):
    with open_plant("example1", isolated=isolated) as plant:
        plant.step({"op": 60.0})
        assert os.listdir(tempfile.gettempdir())
    refused = {"fault": 4, "at_start": 1}
    for file, parameters in ((bad, {"nonsense": 1}), (text, {}), (bad, refused)):
        try:
            open_plant(file, parameters=parameters, isolated=isolated)
        except PlantError:
            continue
        raise AssertionError(file)
for fault, at_start in ((1, 1), (3, 1), (2, 0), (3, 0)):
    try:
        parameters = {"fault": fault, "at_start": at_start}
        with open_plant(bad, parameters=parameters, timeout=0.5) as plant:
            plant.step({})
    except PlantError:
        continue
    raise AssertionError(fault)
left = os.listdir(tempfile.gettempdir())
assert left == [], left
forgotten = open_plant("example1")
"""


def test_no_temporary_folder_is_left(
    faulty: Path, tmp_path: Path, program_environment: dict[str, str]
) -> None:
    text = tmp_path / "text.fmu"
    text.write_text("hello")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", _NOTHING_LEFT, str(faulty), str(text)],
        env=program_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    # The last plant was not closed: the end of the program closed it.
    assert os.listdir(program_environment["TMPDIR"]) == []


_KILLED = """
import sys, threading, time
from fmu_models import open_plant
plants = [open_plant(sys.argv[1]) for _ in range(3)]
plants[1].step({"fault": 7})
threading.Thread(target=lambda: plants[0].step({"fault": 3}), daemon=True).start()
time.sleep(0.3)
print("ready", flush=True)
time.sleep(60)
"""


@linux_only
def test_no_orphan_when_the_program_is_killed(
    faulty: Path, program_environment: dict[str, str]
) -> None:
    """One of its plants is in an endless step, which no signal handler of its own would end.

    Another has started a process of its own.
    """
    program = subprocess.Popen(
        [sys.executable, "-c", _KILLED, str(faulty)],
        env=program_environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    with program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        family = _descendants(program.pid)
        assert len(family) == 5  # the nursery, three plants, and what one of them has started
        assert len(os.listdir(program_environment["TMPDIR"])) == 3
        program.kill()
    deadline = time.monotonic() + 60.0
    while any(Path(f"/proc/{pid}").exists() for pid in family) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert [pid for pid in family if Path(f"/proc/{pid}").exists()] == []
    assert os.listdir(program_environment["TMPDIR"]) == []


def _descendants(pid: int) -> list[int]:
    found = []
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        found += [int(child), *_descendants(int(child))]
    return found


_SIGNALLED = """
import os, signal, sys
from fmu_models import open_plant
signal.signal(signal.SIGINT, lambda *_: None)
signal.signal(signal.SIGTERM, lambda *_: None)
with open_plant("example1") as plant:
    print("ready", flush=True)
    sys.stdin.readline()
    print(plant.step({"op": 60.0})["stem"])
"""


def test_plants_outlive_a_signal_to_the_whole_group(program_environment: dict[str, str]) -> None:
    """A terminal's Ctrl-C and a service manager's SIGTERM: the program decides when it is over."""
    with subprocess.Popen(
        [sys.executable, "-c", _SIGNALLED],
        env=program_environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        os.killpg(program.pid, signal.SIGINT)
        os.killpg(program.pid, signal.SIGTERM)
        program.stdin.write("\n")
        program.stdin.flush()
        assert program.stdout.readline() == "56.0\n"


def test_what_an_fmu_prints_does_not_reach_stdout(program_environment: dict[str, str]) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "from fmu_models import open_plant\nwith open_plant('example1') as p: p.step({})",
        ],
        env=program_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert done.stdout == ""


_FORKED = """
import os, sys
from fmu_models import open_plant
with open_plant("example1") as plant:
    child = os.fork()
    if child == 0:
        with open_plant("example1") as own:
            ok = own.step({"op": 60.0})["stem"] == 56.0
        os._exit(0 if ok else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert plant.step({"op": 60.0})["stem"] == 56.0
"""


def test_a_forked_child_has_plants_of_its_own(program_environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _FORKED],
        env=program_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert os.listdir(program_environment["TMPDIR"]) == []


def test_plants_go_on_and_new_ones_start_when_the_nursery_is_killed() -> None:
    from fmu_models import nursery_client

    with open_plant("example1") as old:
        assert nursery_client._current is not None
        nursery_client._current._process.kill()
        nursery_client._current._process.wait()
        assert old.step({"op": 60.0})["stem"] == 56.0
        with open_plant("example1") as new:
            assert new.step({"op": 60.0})["stem"] == 56.0
        assert old.step({"op": 40.0})["stem"] == 44.0
