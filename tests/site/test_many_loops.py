"""A site of thousands of loops is checked in a time that grows with it, and told in few lines."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

import fieldlink.site.check_warnings
from fieldlink.site import SiteError, check, load_site

HEAD = '[site]\nname = "x"\n[devices.plc]\nlink = "modbus-tcp"\nhost = "192.0.2.1"\n'


def write(folder: Path, count: int, bases: list[int] | None = None) -> Path:
    tags = "".join(f"OP{n},{4 * n},float32\nPV{n},{4 * n + 2},float32\n" for n in range(count))
    (folder / "map.csv").write_text(f"tag,address,type\n{tags}")
    text = HEAD + 'register_map = "map.csv"\n'
    for n in range(count):
        text += f'[loops.L{n}]\ndevice = "plc"\nop = "OP{n}"\npv = "PV{n}"\nperiod = 1.0\n'
        if bases is not None:
            text += f"[loops.L{n}.writeback]\nloop_id = {n + 1}\nbase = {bases[n]}\n"
    (folder / "site.toml").write_text(text)
    return folder / "site.toml"


def test_one_warning_tells_of_all_loops_without_a_mode_tag(tmp_path: Path) -> None:
    assert check(load_site(write(tmp_path, 1))).warnings == (
        "loop L0: without a mode tag, samples in manual cannot be recognised",
    )
    assert check(load_site(write(tmp_path, 40))).warnings == (
        "40 loops without a mode tag (L0, L1, L2, L3, L4 and 35 more): samples in manual cannot be "
        "recognised",
    )


def test_a_warning_of_many_loops_is_one_line(tmp_path: Path) -> None:
    site = write(tmp_path, 50, [400 + 204 * n for n in range(50)])
    lines = (
        "min_windows = 1\nenabled = true\nvalid_for = 60\n"
        "limits = { stick_band = [0.5, 20.0], slip_jump = [0.0, 20.0] }\nloop_id"
    )
    site.write_text(site.read_text().replace("loop_id", lines))
    warnings = check(load_site(site)).warnings
    (said,) = [warning for warning in warnings if "a block is valid for 60 s" in warning]
    assert said.startswith("50 loops (L0, L1, L2, L3, L4 and 45 more): a block is valid for 60 s, ")
    assert len(warnings) == 2


def test_many_copies_of_a_loop_are_one_line_and_other_loops_keep_theirs(tmp_path: Path) -> None:
    site = write(tmp_path, 9)
    text = site.read_text()
    for n in range(1, 7):
        text = text.replace(f'"OP{n}"', '"OP0"').replace(f'"PV{n}"', '"PV0"')
    for n in (7, 8):
        text = text.replace(f'pv = "PV{n}"', f'pv = "PV{n}"\nsp = "PV{n}"')
    site.write_text(text)
    warnings = check(load_site(site)).warnings
    assert (
        "loops L0, L1, L2, L3, L4 and 2 more: all have OP OP0 and PV PV0 of device plc: if they "
        "were copied, correct the tags of all but one"
    ) in warnings
    assert "2 loops (L7, L8): sp and PV are one tag: correct sp, or remove it" in warnings
    assert len(warnings) == 3


def test_a_device_is_looked_through_as_often_with_many_loops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = fieldlink.site.check_warnings.find_apart, []

    def counting(requests: Any, *rest: Any, **keys: Any) -> Any:
        calls.append(len(requests))
        return real(requests, *rest, **keys)

    monkeypatch.setattr("fieldlink.site.check_warnings.find_apart", counting)
    for count in (1, 200):
        check(load_site(write(tmp_path, count)))
    assert len(calls) == 4


@pytest.mark.parametrize("seed", range(5))
def test_areas_clash_as_if_each_were_compared_with_each(tmp_path: Path, seed: int) -> None:
    count, length = 30, 210
    choose = random.Random(seed)
    bases = [choose.randrange(0, 60_000) for _ in range(count)]
    with pytest.raises(SiteError) as caught:
        load_site(write(tmp_path, count, bases))
    said = [line for line in str(caught.value).splitlines() if "shares registers" in line]
    clashing = {
        (later, earlier)
        for later in range(count)
        for earlier in range(later)
        if abs(bases[later] - bases[earlier]) < length
        and _some_parts_overlap(bases[later], bases[earlier])
    }
    assert clashing
    assert len(said) == len(clashing)
    for later, earlier in clashing:
        of_both = [
            line for line in said if f"loops.L{later}." in line and f"of L{earlier};" in line
        ]
        assert len(of_both) == 1


def _some_parts_overlap(one: int, other: int) -> bool:
    taken = set(range(9)) | set(range(10, 210))
    return any(other - one + offset in taken for offset in taken)


def test_a_tag_in_an_area_is_found_among_many(tmp_path: Path) -> None:
    bases = [65_000 - 220 * n for n in range(100)]
    bases[50] = 397  # the last tag of the map ends with register 399
    with pytest.raises(SiteError) as caught:
        load_site(write(tmp_path, 100, bases))
    lines = str(caught.value).splitlines()
    assert len(lines) == 3
    assert all("loops.L50.writeback.base" in line for line in lines)
    assert "ack_result (399) overlaps the tag PV99 (398 to 399)" in lines[-1]
