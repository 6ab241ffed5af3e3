"""Every bad FMU beside a good plant: the message, who goes on, and what is left behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

from fmu_models import fmu_path

_PROGRAM = """
import json, os, sys, tempfile
import psutil
from fmu_models import PlantError, open_plant
ENDLESS = 3
cases = json.loads(sys.argv[1])
said = []
with open_plant("example1") as good:
    for file, options, inputs in cases:
        try:
            # The time-out is short only where no answer will come: machines may be slow.
            with open_plant(file, **{"timeout": 60.0} | options) as plant:
                for row in inputs:
                    if row.get("fault") == ENDLESS:
                        plant._link.timeout = 1.0
                    plant.step(row)
            said.append("nothing was wrong")
        except PlantError as error:
            said.append(f"{type(error).__name__}: {error}")
        good.step({"op": 60.0})
    assert good.time == len(cases)
    children = psutil.Process().children(recursive=True)
    assert len(children) == 2, children  # the nursery and the good plant
    assert len(os.listdir(tempfile.gettempdir())) == 1, os.listdir(tempfile.gettempdir())
assert len(psutil.Process().children(recursive=True)) == 1
assert os.listdir(tempfile.gettempdir()) == []
print(json.dumps(said))
"""

ABORT, SEGFAULT, ENDLESS, REFUSE, NAN = 1, 2, 3, 4, 5


def altered(file: Path, target: Path, change: str) -> str:
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(target, "w") as copy:
        for name in source.namelist():
            content = source.read(name)
            library = name.startswith("binaries/")
            if library and change == "no library":
                continue
            if library and change == "other platform":
                name = "binaries/win64/x.dll"
            if library and change == "truncated":
                content = content[: len(content) // 3]
            if library and change == "lacks functions":
                content = content.replace(b"fmi2DoStep", b"fmi2D0Step")
            if not library and change == "guid":
                content = content.replace(b'guid="{mini}"', b'guid="{no}"')
            copy.writestr(name, content)
        if change == "bomb":
            copy.writestr("resources/a", bytes(1 << 20), zipfile.ZIP_DEFLATED)
            # It says that it extracts to 2 GB; nothing of that size is written here.
            copy.getinfo("resources/a").file_size = 1 << 31
    return str(target)


@pytest.mark.slow
def test_bad_fmus_beside_a_good_one(
    faulty: Path,
    mini_fmus: dict[str, Path],
    tmp_path: Path,
    program_environment: dict[str, str],
) -> None:
    mini, ours = mini_fmus["fmi2"], fmu_path("level")
    text = tmp_path / "text.fmu"
    text.write_text("hello")
    once = {"period": 1.0}
    cases: list[tuple[str, dict[str, object], list[dict[str, float]], str]] = [
        (str(text), {}, [], "PlantFileError: .* it is not an FMU (an FMU is a zip file)"),
        (str(tmp_path / "absent.fmu"), {}, [], "there is no such file"),
        (altered(ours, tmp_path / "bomb.fmu", "bomb"), {}, [], "the limit is 1024 MB"),
        (altered(mini, tmp_path / "bare.fmu", "no library"), once, [], "it offers none"),
        (altered(mini, tmp_path / "win.fmu", "other platform"), once, [], "it offers win64"),
        (altered(mini, tmp_path / "cut.fmu", "truncated"), once, [], "damaged"),
        (altered(mini, tmp_path / "few.fmu", "lacks functions"), once, [], "fmi2DoStep"),
        (altered(mini, tmp_path / "guid.fmu", "guid"), once, [], "the GUID is not {mini}"),
        (
            str(faulty),
            {},
            [{}, {"fault": SEGFAULT}],
            "at 1 s: in a step its process died of SIGSEGV",
        ),
        (str(faulty), {}, [{"fault": ABORT}], "its process died of SIGABRT"),
        (str(faulty), {}, [{"fault": ENDLESS}], "in a step it did not answer for 1 s"),
        (
            str(faulty),
            {"parameters": {"fault": ENDLESS, "at_start": 1}, "timeout": 1.0},
            [],
            "while it started it did not answer for 1 s",
        ),
        (str(faulty), {}, [{"fault": REFUSE}], "this plant refuses"),
        (str(faulty), {}, [{"fault": NAN}], "pv is no finite number any more"),
        (str(mini), once, [{"fault": 1}], "nothing was wrong"),  # a warning
        (str(mini), once, [{"fault": 3}], "status 3 (error)"),
        (str(mini), once, [{"fault": 4}], "status 4 (fatal)"),
        (str(mini), once, [{"fault": 5}], "ended the simulation at 0 s (has it reached its stop"),
        (str(mini), once, [{"fault": 6}], "output tank.h is nan at 1 s"),
        (str(mini), once, [{"fault": 7}], "output tank.h is inf at 1 s"),
        (str(mini), {"period": 2.0}, [{}], "the FMU discarded the step of 2 s"),
        (str(ours), {"period": 0.3}, [{}], "the step must be a multiple of 1 s"),
        (str(mini), once, [{"tank.inflw": 1.0}], "did you mean 'tank.inflow[1]'"),
        (str(mini), once, [{"tank.h": 1.0}], "is output (continuous) and cannot be set"),
        (str(ours), {}, [{"seed": 3.0}], "'seed' is fixed; give it when the plant is opened"),
        (str(ours), {"parameters": {"stem": 3.0}}, [], "'stem' is output"),
        (str(mini), {}, [], "names no step size"),
    ]
    request = [case[:3] for case in cases]
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", _PROGRAM, json.dumps(request)],
        env=program_environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert fmpy.platform in ("linux64", "darwin64")  # isolation needs POSIX
    for (file, _options, _inputs, words), said in zip(cases, json.loads(done.stdout), strict=True):
        for part in words.split(" .* "):
            assert part in said, (Path(file).name, said)
    assert os.listdir(program_environment["TMPDIR"]) == []
