"""A fleet with many findings still shows at once which valve to repair first."""

from __future__ import annotations

import re
from typing import Any

import pytest

from fieldlink.web.responses import render


def finding(number: int) -> dict[str, Any]:
    name = f"FC{number:03d}"
    return {
        "finding": f"20260304-100000-{number}",
        "state": "confirmed",
        "text": f"{name}: sticky valve, swings every 51 s",
        "born": "2026-03-04T10:00:00+00:00",
        "action": "Check the packing.",
        "loops": [name],
    }


@pytest.mark.parametrize(("count", "folded"), [(1, 0), (6, 0), (7, 1), (48, 42)])
def test_the_first_findings_are_shown_and_the_others_folded(count: int, folded: int) -> None:
    page = render("fleet_findings.html.j2", findings=[finding(n) for n in range(count)])
    shown, _, rest = page.partition("<details>")
    assert shown.count("<li>") == count - folded
    assert rest.count("<li>") == folded
    said = re.findall(r"<summary>(\d+) more</summary>", page)
    assert said == ([str(folded)] if folded else [])
