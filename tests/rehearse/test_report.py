"""The report's first page: what was rehearsed, what was found, what to do on site."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from fieldlink.lab.rehearse import ScenarioFile, rehearse
from fieldlink.lab.rehearse.briefing import find_unit
from fieldlink.lab.rehearse.report import rehearsal_figure, write_report

MakeScenario = Callable[..., ScenarioFile]

MORE = """\
[valve]
stick_band = [[0, 3], [100, 9]]
slip_jump = [[0, 1]]
[[sensor]]
kind = "freeze"
begin = 30
end = 40
[[network]]
kind = "write_flipped"
begin = 0
end = 50
share = 0.5
[[maintenance]]
kind = "manual"
begin = 60
end = 70
[[misestimate]]
begin = 80
end = 90
gain_factor = -1.0
"""


def text_of(page: str) -> str:
    without_pictures = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]+>", " ", without_pictures).split())


def test_the_first_page_says_what_matters(make_scenario: MakeScenario, tmp_path: Path) -> None:
    run = rehearse(make_scenario(more=MORE, daemon="write_back = true"))
    page = write_report(run, tmp_path).read_text()
    first, _, rest = page.partition('<div class="next"></div>')
    said = text_of(first)
    for words in (
        "What was rehearsed",
        "scanned every 1 s",
        "PI, gain 0.8 % per unit of PV, integral time 10 s",
        "stick band S 3 at 0 s to 9 at 100 s",
        "Transmitter stands still from 30 to 40 s",
        "blocks of which a bit changes on the way from 0 to 50 s, 50% of them",
        "An operator has the loop from 60 to 70 s",
        "gain of the wrong sign",
        "windows of 60 samples (60 s), model written to the PLC",
        "What was found",
        "Windows judged",
        "What to do on site",
        "the operator&#39;s enable register works",
    ):
        assert words in said, words
    assert "What was expected" in rest


def test_a_failed_rehearsal_says_not_to_go(make_scenario: MakeScenario, tmp_path: Path) -> None:
    expect = '[[expect]]\nkind = "samples"\nof = "bad"\nat_least = 1\n'
    page = write_report(rehearse(make_scenario(expect=expect)), tmp_path).read_text()
    said = text_of(page)
    assert "Do not go yet: 1 of 1 expectations are not met" in said
    assert re.search(r"Missed: .* found: 0\b", said[: said.index("What was rehearsed")])


def test_pictures_have_units(make_scenario: MakeScenario) -> None:
    file = make_scenario(plant="", controller='kind = "pi"\ngain = 0.8\nintegral_time = 10.0')
    assert find_unit(file) == ""  # example1 is without dimension
    run = rehearse(file)
    labels = [a.get_ylabel() for a in rehearsal_figure(run.course, title="t", unit="degC").axes]
    assert labels == ["OP, stem / %", "PV, SP / degC", "stick band S / % of OP"]
