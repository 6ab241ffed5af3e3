"""A recorded loop played through registers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fieldlink.lab.plc import VirtualPlc
from fieldlink.registers import DataType, Table, decode
from fieldlink.site import Site

MakeSite = Callable[..., Site]

ROWS = 60


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "loop.csv"
    lines = [f"{50 + k % 7},{20 + 0.125 * k},{25},{int(k < 40)}" for k in range(ROWS)]
    lines[10] = "53,,25,1"
    path.write_text("op,pv,sp,auto\n" + "\n".join(lines) + "\n")
    return path


def signals(plc: VirtualPlc) -> list[float]:
    words = plc.image.read(Table.HOLDING, 0, 7)
    reals = [float(decode(words[i : i + 2], DataType.FLOAT32)) for i in (0, 2, 4)]
    return [*reals, float(words[6])]


def test_every_row_comes_through_the_registers(make_site: MakeSite, recording: Path) -> None:
    rows = []
    with VirtualPlc(make_site(plant='recording = "loop.csv"'), "plc") as plc:
        for _ in range(ROWS):
            plc.scan()
            rows.append(signals(plc))
    op, pv, sp, mode = np.array(rows).T
    np.testing.assert_array_equal(op, [50 + k % 7 if k != 10 else 53 for k in range(ROWS)])
    expected = 20 + 0.125 * np.arange(ROWS)
    expected[10] = np.nan
    np.testing.assert_array_equal(pv, expected)
    np.testing.assert_array_equal(sp, 25.0)
    np.testing.assert_array_equal(mode, [1] * 40 + [0] * 20)
    assert recording.exists()


def test_after_the_last_row_the_signals_stand_and_the_mode_is_manual(
    make_site: MakeSite, recording: Path
) -> None:
    recording.write_text(recording.read_text().replace(",0\n", ",1\n"))
    with VirtualPlc(make_site(plant='recording = "loop.csv"'), "plc") as plc:
        for _ in range(ROWS):
            plc.scan()
        last = signals(plc)
        assert last[3] == 1.0
        for _ in range(5):
            plc.scan()
        assert signals(plc) == [*last[:3], 0.0]
        assert plc.image.read(Table.HOLDING, 8, 1) == [ROWS + 5]


def test_chem10_is_read_back_as_it_was_recorded(make_site: MakeSite, shared_data: Path) -> None:
    path = shared_data / "isdb" / "CHEM10.csv"
    recorded = np.genfromtxt(path, delimiter=",", names=True, dtype=np.float32)
    with VirtualPlc(make_site(plant=f'recording = "{path}"'), "plc") as plc:
        for row in recorded:
            plc.scan()
            assert signals(plc)[:2] == [row["op"], row["pv"]]
