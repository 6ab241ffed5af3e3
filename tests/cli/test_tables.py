"""What a person reads of a result: verdict, doubt and the next best explanation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from rich.console import Console

from estimator import Identification, Verdict, identify
from estimator.result import RunnerUp
from fieldlink.cli.tables import identification_table, process_text, verdict_text
from fieldlink.pictures import PictureError, identification_figure, save
from tests.cli.conftest import Run

OP, PV = np.full(80, 40.0), np.linspace(49.0, 51.0, 80)


@pytest.fixture(scope="module")
def sure() -> Identification:
    """A result of our own making: the verdict does not depend on a search here."""
    return replace(identify(OP, PV), verdict=Verdict.STICTION, score=12.345)


def test_an_uncertain_verdict_is_worded_as_one(sure: Identification) -> None:
    assert verdict_text(sure).plain == "the valve sticks   (verdict stiction, score 12.35)"
    doubtful = verdict_text(replace(sure, uncertain=True)).plain
    assert doubtful.startswith("the valve sticks, but this is uncertain")
    assert "verdict stiction, uncertain, score 12.35" in doubtful


def test_a_window_without_a_score_shows_a_dash() -> None:
    assert verdict_text(identify(OP, PV)).plain.endswith("(verdict not_assessable, score -)")


def test_the_table_names_the_next_explanation_and_what_cannot_be_told(
    sure: Identification,
) -> None:
    rival = RunnerUp("healthy valve", "lags", 2, 12.345)
    result = replace(sure, runners_up=(rival,), identifiability=("the slip jump is vague",))
    console = Console(width=120)
    with console.capture() as printed:
        console.print(identification_table(result))
    rows = {line[:21].strip(): line[21:].strip() for line in printed.get().splitlines()}
    assert rows["next explanation"].endswith("healthy valve; log-likelihood 12.3 lower")
    assert rows["cannot tell"].endswith("the slip jump is vague")


def test_process_parameters_have_units_and_the_dead_time_is_shown_once(
    sure: Identification,
) -> None:
    values = MappingProxyType({"time_constant_1": 8.0, "swing_period": 90.0, "dead_time": 3.0})
    process = replace(sure.process, structure="lag", parameters=values, dead_time_samples=1)
    assert process_text(process) == "lag: time constant 1 8 s, swing period 90 s"
    console = Console(width=120)
    with console.capture() as printed:
        console.print(identification_table(replace(sure, process=process)))
    rows = {line[:21].strip(): line[21:].strip() for line in printed.get().splitlines()}
    assert rows["dead time"] == "3 s (1 sample)"
    assert process_text(identify(OP, PV).process) == "none"


def test_the_picture_names_an_uncertain_verdict(sure: Identification) -> None:
    doubtful = replace(sure, uncertain=True)
    figure = identification_figure(OP, PV, None, doubtful, title="FC101")
    assert figure.get_suptitle() == "FC101: stiction (uncertain), score 12.3"
    figure = identification_figure(OP, PV, None, identify(OP, PV), title="FC101")
    assert figure.get_suptitle() == "FC101: not assessable"


@pytest.mark.parametrize("head", ["OP [/min]", "OP [red]", "OP :100:"])
@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_what_looks_like_markup_in_a_name_is_a_name(
    fieldlink: Run, tmp_path: Path, command: str, head: str
) -> None:
    rows = [f"{40 + 0.01 * (k % 7)},{'Bad' if k == 5 else 50}" for k in range(80)]
    (tmp_path / "[bold]FC1.csv").write_text("\n".join([f"{head},PV [/h]", *rows]))
    done = fieldlink(command, "[bold]FC1.csv")
    assert done.returncode == 0, done.stderr
    for name in ("[bold]FC1.csv", head, "PV [/h]"):
        assert name in done.stdout


def test_a_picture_without_a_format_is_not_written_under_another_name(tmp_path: Path) -> None:
    with pytest.raises(PictureError, match=r"FC101: the picture has no format; end it in \.png"):
        save(
            identification_figure(OP, PV, None, identify(OP, PV), title="FC101"), tmp_path / "FC101"
        )
    assert not any(tmp_path.iterdir())


def test_several_recordings_are_named_as_their_files(fieldlink: Run, tmp_path: Path) -> None:
    (tmp_path / "[red]a.csv").write_text("OP [/min]\n" + "much\n" * 60)
    (tmp_path / "[#b].csv").write_text("op,pv\n" + "40,50\n" * 60)
    done = fieldlink("diagnose", ".")
    assert done.returncode == 1, done.stderr
    for name in ("[red]a", "[/min]", "[#b]"):
        assert name in done.stdout
