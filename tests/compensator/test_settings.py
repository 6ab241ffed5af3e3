"""What cannot be worked with is refused at the door, with what was found."""

import math

import pytest

from compensator import (
    CompensatorError,
    HybridMpc,
    HybridSettings,
    RefusalKind,
    RetrySettings,
    Supervisor,
    SupervisorSettings,
    UnawareMpc,
    Uncertainty,
    WatchSettings,
)
from compensator.stem_tracking.tracker_settings import TrackerSettings
from compensator.stem_tracking.tracking import NOISE_KINDS
from fieldlink.lab.study.closed_loop import EXAMPLE_1
from loop_model import LoopModel, ProcessModel, ValveModel

P = EXAMPLE_1.process


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"offset_memory": 0.0}, "offset_memory must be positive and finite; got 0.0"),
        ({"horizon": 2.5}, "horizon must be a whole number of at least 0; got 2.5"),
        ({"spread": math.nan}, "spread must not be negative and must be finite; got nan"),
        ({"edge": 1.0}, "edge must be below 1"),
    ],
)
def test_settings_that_cannot_work_are_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(CompensatorError, match=words):
        HybridSettings(**changes)  # type: ignore[arg-type]


def test_settings_of_the_watch_and_of_the_supervisor_are_checked() -> None:
    with pytest.raises(CompensatorError, match="travel_budget must be positive"):
        WatchSettings(travel_budget=0.0)
    with pytest.raises(CompensatorError, match="periods must not fall"):
        WatchSettings(periods=(3.0, 2.0, 4.0))
    with pytest.raises(CompensatorError, match="history must be a whole number"):
        SupervisorSettings(history=0)
    with pytest.raises(CompensatorError, match="gain_sign is -1, 1, or 0"):
        SupervisorSettings(gain_sign=3)
    with pytest.raises(CompensatorError, match="after must be positive"):
        RetrySettings(after=0)
    with pytest.raises(CompensatorError, match="static_friction must not be negative"):
        Uncertainty(math.nan)


@pytest.mark.parametrize("name", ["gains", "jumps", "frictions"])
def test_factors_of_other_valves_and_gains_are_checked(name: str) -> None:
    with pytest.raises(CompensatorError, match=f"{name} are factors above 0"):
        TrackerSettings(NOISE_KINDS[0], **{name: (1.0, -0.5)})  # type: ignore[arg-type]


def test_a_horizon_inside_the_dead_time_is_refused() -> None:
    late = LoopModel(EXAMPLE_1.valve, ProcessModel((-0.9,), (0.1,), 12, 0.0, 1.0))
    with pytest.raises(CompensatorError, match="ends before the dead time of 12"):
        HybridMpc(late, HybridSettings(horizon=12))


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        (LoopModel(EXAMPLE_1.valve, ProcessModel((-1.3,), (0.1,), 1, 0.0, 1.0)), "UNSTABLE"),
        (LoopModel(EXAMPLE_1.valve, ProcessModel(P.a, P.b, 1, 0.0, 2.0)), "PERIOD"),
        (LoopModel(EXAMPLE_1.valve, ProcessModel((-0.9,), (-0.1,), 1, 0.0, 1.0)), "WRONG_SIGN"),
        (LoopModel(EXAMPLE_1.valve, ProcessModel((-1.0,), (-0.1,), 1, 0.0, 1.0)), "WRONG_SIGN"),
        (LoopModel(EXAMPLE_1.valve, ProcessModel((-0.9,), (0.1,), 65535, 0.0, 1.0)), "RANGE"),
        (LoopModel(ValveModel(0.0, 0.0), P), "RANGE"),
        (LoopModel(ValveModel(120.0, 1.0), P), "RANGE"),
    ],
)
def test_an_offer_that_cannot_be_used_is_refused_with_its_kind(model: LoopModel, kind: str) -> None:
    supervisor = Supervisor(UnawareMpc(P), SupervisorSettings(gain_sign=1, period=1.0))
    assert not supervisor.offer(model)
    assert supervisor.refused is RefusalKind[kind]
    assert supervisor.refusal
    assert supervisor.offer(EXAMPLE_1)
    assert supervisor.refused is RefusalKind.NONE
