"""Every folder of ``cases`` is a site file with what it must lead to: an error's text, or a report.

``expected_error.txt`` is the whole message; ``expected_check.txt`` the report in a few lines. The
folder's own path is left out of both.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from fieldlink.site import CheckReport, SiteError, check, load_site

CASES = sorted(path for path in (Path(__file__).parent / "cases").iterdir() if path.is_dir())


def lines_of(report: CheckReport) -> list[str]:
    lines = [f"historian {report.historian}"]
    for device in report.devices:
        lines.append(f"device {device.name} {device.address} {device.order}")
        lines.extend(
            f"  FC{request.function} {request.first} to {request.last}: {' '.join(request.tags)}"
            for request in device.requests
        )
    for loop in report.loops:
        lines.append(
            f"loop {loop.name}: OP and PV together {loop.op_pv_together}, "
            f"window {loop.window_seconds:g} s, every {loop.estimate_every:g} s"
        )
        if loop.writeback is not None:
            areas = ", ".join(f"{part} {first}" for part, first, _ in loop.writeback.areas)
            lines.append(f"  block {loop.writeback.loop_id}: {areas}")
    return [*lines, *(f"warning: {warning}" for warning in report.warnings)]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Path) -> None:
    def said(text: str) -> str:
        return text.replace(f"{case}/", "").strip()

    expected_error = case / "expected_error.txt"
    if expected_error.exists():
        with pytest.raises(SiteError) as caught:
            load_site(case / "site.toml")
        assert said(str(caught.value)) == expected_error.read_text(encoding="utf-8").strip()
        return
    report = check(load_site(case / "site.toml"))
    expected = (case / "expected_check.txt").read_text(encoding="utf-8").strip()
    assert said("\n".join(lines_of(report))) == expected
