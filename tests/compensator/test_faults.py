"""Whatever happens before and after a take-over, no loop is left running away.

A stateful search drives manual, set-points, loads, blocks right and wrong, restarts, bad PV and PV
that jumps in any order. After each stretch it asks: was OP inside its limits, and did the
compensator keep the loop while the error stayed far beyond what was known of it?
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from compensator import HybridSettings, OpLimits, Supervisor, SupervisorSettings, UnawareMpc
from compensator.supervising.loop_judge import LoopJudge
from compensator.supervising.record_check import RecordCheckSettings
from compensator.supervising.watch import WatchVerdict
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from loop_model import LoopModel, ProcessModel, ValveModel

LIMITS = OpLimits(10.0, 90.0)
LAG = EXAMPLE_1.process
PROCESSES = {
    "lag": LAG,
    "oscillatory": ProcessModel((-1.8, 0.84), (0.02, 0.02), 2, 0.0, 1.0),
    "dead time of ten": ProcessModel((-0.9,), (0.1,), 10, 0.0, 1.0),
}
BLIND = RecordCheckSettings(shortest=10**6)
"""The record refuses no model beforehand: the watch alone has to notice."""
UNDISTURBED = 240
"""Scans after an offer: without a watch a model of the wrong sign has left the range by then,
although 11 of them pass before it has relived what was before."""
TOLERATED = 60
"""Scans in a row that a compensated loop may be far beyond what was known of it."""


def models_of(p: ProcessModel) -> list[LoopModel]:
    """Return models of Example 1's valve and a process, right and wrong."""
    wrong_sign = ProcessModel(p.a, tuple(-b for b in p.b), p.dead_time, 0.0, p.period)
    late = ProcessModel(p.a, p.b, p.dead_time + 4, 0.0, p.period)
    return [
        LoopModel(EXAMPLE_1.valve, p),
        LoopModel(ValveModel(5.0, 1.5), p),
        LoopModel(ValveModel(16.0, 4.5), p),
        LoopModel(EXAMPLE_1.valve, wrong_sign),
        LoopModel(EXAMPLE_1.valve, late),
        LoopModel(ValveModel(0.0, 0.0), p),
    ]


class LoopUnderStress(RuleBasedStateMachine):
    """A loop and what operators, blocks and sensors do to it."""

    @initialize(
        process=st.sampled_from(sorted(PROCESSES)),
        blind=st.booleans(),
        seed=st.integers(0, 1000),
        warm=st.integers(60, 300),
        by_hand=st.sampled_from([0, 5, 40]),
        number=st.sampled_from([0, 1, 2, 3, 3, 3, 4, 5]),
    )
    def begin(
        self, process: str, blind: bool, seed: int, warm: int, by_hand: int, number: int
    ) -> None:
        self.process, self.blind = PROCESSES[process], blind
        self.models = models_of(self.process)
        # A unit of PV is what it is in Example 1.
        self.unit = self.process.gain / LAG.gain
        self.rest = self.process.gain * 50.0
        self.supervisor = self.fresh()
        self.plant = Plant(self.process, EXAMPLE_1.valve, 50.0, 48.0)
        self.noise = np.random.default_rng(seed)
        self.op, self.sp, self.load = 50.0, self.rest + 2.5 * self.unit, 0.0
        self.known, self.far, self.worst, self.since = 0.0, 0, 0, 0
        self.run(warm)
        self.run(by_hand, manual=self.op)
        self.offer(number)

    def fresh(self) -> Supervisor:
        check = BLIND if self.blind else RecordCheckSettings()
        stated = SupervisorSettings(HybridSettings(LIMITS), check=check, gain_sign=0)
        return Supervisor(UnawareMpc(self.process), stated)

    def run(
        self,
        scans: int,
        *,
        manual: float | None = None,
        bad: bool = False,
        jump: float = 0.0,
    ) -> None:
        for _ in range(scans):
            pv = self.plant.pv
            seen = math.nan if bad else pv + jump * self.unit
            had = self.supervisor.compensating
            action = self.supervisor.step(seen, self.sp, self.op, automatic=manual is None)
            self.op = action.op if manual is None else manual
            assert math.isfinite(self.op)
            self.since += 1
            error = abs(pv - self.sp)
            if not had:
                self.known = max(self.known, error)
            # The way to a new set-point or load, and what no sensor shows, is not run away.
            far = error > 3.0 * max(self.known, 0.6 * self.unit)
            counts = had and not bad and not jump and self.since > 60 and far
            self.far = self.far + 1 if counts else 0
            self.worst = max(self.worst, self.far)
            noise = float(self.noise.normal(0.0, 0.01 * self.unit))
            self.plant.step(self.op, noise, self.load)

    @rule(scans=st.integers(20, 250))
    def wait(self, scans: int) -> None:
        self.run(scans)

    @rule(number=st.integers(0, 5))
    def offer_another(self, number: int) -> None:
        self.offer(number)

    def offer(self, number: int) -> None:
        model = self.models[number]
        taken = self.supervisor.offer(model)
        assert taken or self.supervisor.refusal
        if not taken and model.valve.stick_band > 0.0 and sum(model.process.b) > 0.0:
            assert "worse" in self.supervisor.refusal
        self.run(UNDISTURBED)

    @rule(step=st.floats(-8.0, 8.0))
    def change_setpoint(self, step: float) -> None:
        self.sp, self.since = self.rest + step * self.unit, 0
        self.run(60)

    @rule(load=st.sampled_from([-4.0, 0.0, 4.0]))
    def change_load(self, load: float) -> None:
        self.load, self.since = load, 0
        self.run(60)

    @rule(scans=st.integers(1, 60), change=st.floats(-3.0, 3.0))
    def take_to_manual(self, scans: int, change: float) -> None:
        by_hand = min(max(self.op + change, LIMITS.low), LIMITS.high)
        self.run(scans, manual=by_hand)
        self.since = 0

    @rule(scans=st.integers(1, 30))
    def lose_pv(self, scans: int) -> None:
        self.run(scans, bad=True)
        self.since = 0

    @rule(
        scans=st.sampled_from([1, 2, 3, 4, 20]),
        jump=st.sampled_from([-1e30, -1e4, -60.0, 30.0, 200.0, 1e10, 1e38, 1e200]),
    )
    def let_pv_jump(self, scans: int, jump: float) -> None:
        before = {known.model for known in self.supervisor.memory.given_up}
        self.run(scans, jump=jump)
        # Whatever the model is, a fault of PV says nothing of it.
        assert {known.model for known in self.supervisor.memory.given_up} <= before
        self.since = 0

    @rule()
    def restart(self) -> None:
        memory = self.supervisor.memory
        self.supervisor = self.fresh()
        self.supervisor.restore(memory)
        assert self.supervisor.memory == memory

    @invariant()
    def nothing_runs_away(self) -> None:
        if hasattr(self, "worst"):
            assert self.worst <= TOLERATED
            assert 0.0 <= self.op <= 100.0


class LoopUnderMoreStress(LoopUnderStress):
    """The same for longer."""


BRIEF = settings(
    max_examples=7,
    stateful_step_count=8,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
LoopUnderStress.TestCase.settings = BRIEF
TestLoopUnderStress = LoopUnderStress.TestCase
LoopUnderMoreStress.TestCase.settings = settings(BRIEF, max_examples=30)
TestLoopUnderMoreStress = pytest.mark.thorough(LoopUnderMoreStress.TestCase)


@pytest.mark.parametrize("process", sorted(PROCESSES))
def test_the_search_sees_a_loop_without_a_watch_run_away(
    process: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LoopJudge, "push", lambda *_: WatchVerdict.FINE)
    state = LoopUnderStress()
    state.begin(process=process, blind=True, seed=2, warm=180, by_hand=0, number=3)
    state.wait(scans=100)
    assert state.worst > TOLERATED
