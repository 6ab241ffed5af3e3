"""What a compensator keeps over a restart: the file, the service, and the simulated PLC."""

from __future__ import annotations

import resource
import signal
from pathlib import Path

import pytest

from compensator import (
    GivenUp,
    LoopFigures,
    LoopMemory,
    RefusalKind,
    Uncertainty,
)
from compensator.stem_tracking.friction import FrictionPrior
from fieldlink.compensate.memory_file import MemoryFileError, load_memory, save_memory
from fieldlink.compensate.service import CompensateService
from fieldlink.lab.plc.lockstep import LockstepLink
from fieldlink.links import SystemClock
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.compensate.test_service import make_site

PROCESS = ProcessModel((-0.9,), (0.1,), 2, -5.0, 1.0)
GIVEN_UP = GivenUp(
    LoopModel(ValveModel(6.0, 2.0), PROCESS),
    FrictionPrior(uncertainty=Uncertainty(0.3, 0.2)),
    3600,
    RefusalKind.TRAVEL,
)
MEMORY = LoopMemory(LoopFigures(0.5, 0.02, 80.0, 2.5), (GIVEN_UP,), -1)


def test_what_was_saved_comes_back_less_the_time_that_passed(tmp_path: Path) -> None:
    file = tmp_path / "FC101.compensator.json"
    save_memory(file, "FC101", MEMORY, period=2.0, now=1000.0)
    assert load_memory(file, "FC101", period=2.0, now=1000.0) == MEMORY
    later = load_memory(file, "FC101", period=2.0, now=1000.0 + 7000.0)
    assert later.given_up[0].left == 3600 - 3500
    assert later.given_up[0].why is RefusalKind.TRAVEL
    gone = load_memory(file, "FC101", period=2.0, now=1000.0 + 7201.0)
    assert gone.given_up == ()
    assert gone.figures == MEMORY.figures
    assert [path.name for path in tmp_path.iterdir()] == ["FC101.compensator.json"]


def test_a_full_disk_leaves_the_memory_before(tmp_path: Path) -> None:
    file = tmp_path / "FC101.compensator.json"
    save_memory(file, "FC101", MEMORY, period=2.0, now=1000.0)
    before, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16, before[1]))
    try:
        with pytest.raises(MemoryFileError, match=r"cannot be written \(File too large\)"):
            save_memory(file, "FC101", LoopMemory(), period=2.0, now=1000.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert [path.name for path in tmp_path.iterdir()] == ["FC101.compensator.json"]
    assert load_memory(file, "FC101", period=2.0, now=1000.0) == MEMORY


def test_without_a_file_nothing_is_remembered(tmp_path: Path) -> None:
    assert load_memory(tmp_path / "none", "FC101", period=1.0, now=0.0) == LoopMemory()


@pytest.mark.parametrize("text", ["", "{}", '{"version": 1, "loop": "FC101"}', "\x00"])
def test_a_file_that_is_none_of_ours_is_named_with_the_remedy(tmp_path: Path, text: str) -> None:
    file = tmp_path / "memory.json"
    file.write_text(text)
    with pytest.raises(
        MemoryFileError, match=r"memory\.json: not written by a compensator; delete it"
    ):
        load_memory(file, "FC101", period=1.0, now=0.0)


def test_the_memory_of_another_loop_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "memory.json"
    save_memory(file, "FC101", MEMORY, period=1.0, now=0.0)
    with pytest.raises(MemoryFileError, match="loop FC101, not of FC102"):
        load_memory(file, "FC102", period=1.0, now=0.0)
    with pytest.raises(MemoryFileError, match="cannot be written"):
        save_memory(tmp_path / "no" / "folder", "FC101", MEMORY, period=1.0, now=0.0)


async def test_the_service_begins_with_what_an_earlier_run_knew(tmp_path: Path) -> None:
    site = make_site(tmp_path)
    first = CompensateService(site, "FC101", write=True)
    first.supervisor.restore(MEMORY)
    await first.close()
    second = CompensateService(site, "FC101")
    assert second.supervisor.memory.figures == MEMORY.figures
    assert second.supervisor.memory.gain_sign == -1
    assert not second.supervisor.offer(GIVEN_UP.model)
    (tmp_path / "FC101.compensator.json").unlink()
    assert CompensateService(site, "FC101").supervisor.memory == LoopMemory()


async def test_a_dry_run_keeps_nothing(tmp_path: Path) -> None:
    """Its model is judged by moves that were not made: a run that writes would refuse it."""
    dry = CompensateService(make_site(tmp_path), "FC101")
    dry.supervisor.restore(MEMORY)
    await dry.close()
    assert not (tmp_path / "FC101.compensator.json").exists()


async def test_a_full_disk_does_not_end_a_compensator(tmp_path: Path) -> None:
    told: list[str] = []
    site = make_site(tmp_path)
    service = CompensateService(site, "FC101", write=True, tell=told.append)
    service.supervisor.restore(MEMORY)
    (tmp_path / "FC101.compensator.json").mkdir()  # cannot be replaced, as where there is no room
    await service.close()
    assert len(told) == 1
    assert "memory cannot be written" in told[0]


PLC = """\
[site]
name = "test"
[devices.plc]
link = "fmu"
register_map = "map.csv"
[loops.FC101]
device = "plc"
op = "FC101.OP"
pv = "FC101.PV"
sp = "FC101.SP"
period = 1.0
[loops.FC101.plant]
fmu = "example1"
controller = "mpc"
"""


async def test_the_simulated_plc_retains_it_over_a_restart(tmp_path: Path) -> None:
    make_site(tmp_path)
    (tmp_path / "plc.toml").write_text(PLC)
    from fieldlink.site import load_site

    link = LockstepLink(load_site(tmp_path / "plc.toml"), "plc", SystemClock())
    await link.open()
    before = link.plc.supervisor("FC101")
    assert before is not None
    before.restore(MEMORY)
    await link.close()
    await link.open()
    after = link.plc.supervisor("FC101")
    assert after is not None
    assert after is not before
    assert after.memory == MEMORY
    await link.close()
