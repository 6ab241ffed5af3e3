"""What looks like a cause and is a drifting load, amplified noise, or a neighbour's motion."""

from __future__ import annotations

import pytest

from benchmarks.diagnosis_families.tuning.advised import draw_advised
from benchmarks.diagnosis_families.tuning.events import draw_event
from benchmarks.diagnosis_families.tuning.paced import draw_paced
from benchmarks.diagnosis_families.tuning.singles import draw_loop
from fieldlink.diagnosis import Diagnosis, LoopSignals, diagnose, find_groups
from tests.seeds import cases_in_suite, in_suite


def found(loop: object) -> Diagnosis:
    signals = (loop.op, loop.pv, loop.sp)  # type: ignore[attr-defined]
    return diagnose(*signals, period=loop.period, advice=False)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("causes", "seed"),
    [("slow_tuning", 20010), ("quiet", 20005), ("sticky_valve+slow_tuning", 20011)],
)
def test_drift_of_the_load_is_no_curved_characteristic(causes: str, seed: int) -> None:
    answer = found(draw_loop(tuple(causes.split("+")), seed))
    assert "characteristic" not in {cause.name for cause in answer.causes}


@pytest.mark.parametrize("seed", in_suite(1, [20004, 20000, 20012]))
def test_a_curve_that_holds_under_long_noise_is_told(seed: int) -> None:
    assert found(draw_loop(("characteristic",), seed)).first.name == "characteristic"


@pytest.mark.parametrize(
    ("cause", "seed"), [("quiet", 20000), ("quiet", 20041), ("slow_tuning", 20077)]
)
def test_a_few_slow_swings_of_the_load_are_no_wave_from_outside(cause: str, seed: int) -> None:
    answer = found(draw_loop((cause,), seed))
    assert "external_oscillation" not in {one.name for one in answer.causes}


def test_noise_that_keeps_a_resonance_going_is_tight_tuning() -> None:
    loops = [draw_loop(("tight_tuning",), 20024)]
    loops += [draw_advised("tight_tuning", seed) for seed in (20018, 20029)]
    assert {found(loop).first.name for loop in loops} == {"tight_tuning"}


@pytest.mark.xfail(strict=True, reason="loads alone, without the process, are as likely")
@pytest.mark.parametrize("seed", in_suite(1, [20214, 20204, 20215]))
def test_an_integral_time_too_long_for_the_record_is_slow_where_the_room_is_sure(seed: int) -> None:
    answer = found(draw_loop(("slow_tuning",), seed))
    assert answer.first.name == "slow_tuning"
    assert "probability" in answer.first.evidence[0]


@pytest.mark.parametrize(
    "seed",
    [
        20004,
        pytest.param(
            20007,
            marks=pytest.mark.xfail(
                strict=True, reason="a well-tuned loop that headroom of two lags calls slow"
            ),
        ),
        pytest.param(
            20046,
            marks=pytest.mark.xfail(
                strict=True,
                reason="a load that is smooth at both of its corners seems to leave room",
            ),
        ),
    ],
)
def test_a_well_tuned_loop_whose_error_lasts_is_quiet_where_surely_no_room_is_left(
    seed: int,
) -> None:
    assert found(draw_paced("quiet", seed)).first.name == "quiet"


@pytest.mark.parametrize(
    ("plant", "seed", "names"),
    cases_in_suite(
        1,
        [
            ("recycle", 20009, ("LC104", "LC106")),
            ("cascade", 5000, ("LC105", "LC107")),
            ("heat", 20021, ("LC103", "LC105")),
            ("header", 5005, ("LC102", "LC103")),
            ("heat", 20000, ("LC101", "LC102", "LC106")),
        ],
    ),
)
def test_amplified_noise_of_neighbours_is_no_event(
    plant: str, seed: int, names: tuple[str, ...]
) -> None:
    loops = draw_event(plant, "none", seed).loops
    signals = {
        name: LoopSignals(one.op, one.pv, one.sp, one.period)
        for name, one in loops.items()
        if name in names
    }
    answers = {name: found(loops[name]) for name in names}
    assert find_groups(signals, answers) == ()
