"""The compensator takes over with the block's model, and gives the loop back without a bump."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from compensator import SupervisorState, WithdrawReason
from fieldlink.lab.plc import Truth, VirtualPlc
from fieldlink.registers import Fallback, ParameterBlock, Status
from fieldlink.site import Site
from loop_model import LoopModel, ProcessModel, ValveModel

MakeSite = Callable[..., Site]
MakeBlock = Callable[..., ParameterBlock]

BEFORE, SETTLING, AFTER = 1000, 200, 800


def travel(stem: np.ndarray) -> float:
    return float(np.sum(np.abs(np.diff(stem))))


def changeovers(truth: Truth) -> np.ndarray:
    """The cycles in which the compensator came or went."""
    return np.flatnonzero(np.diff(truth.compensated.astype(int))) + 1


def test_the_oscillation_ends_when_the_block_arrives(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(BEFORE)
        writer.send(make_block(1))
        writer.run(SETTLING + AFTER)
        truth = plc.truth("FC101")
        assert plc.supervisor("FC101").state is SupervisorState.COMPENSATING
    before, after = slice(BEFORE - AFTER, BEFORE), slice(-AFTER, None)
    assert not truth.compensated[:BEFORE].any()
    assert truth.compensated[after].all()
    assert np.std(truth.pv[after]) < 0.35 * np.std(truth.pv[before])
    assert travel(truth.stem[after]) <= travel(truth.stem[before])
    assert np.mean(truth.pv[after]) == pytest.approx(55.0, abs=0.2)
    (taken_over,) = changeovers(truth)
    assert truth.op[taken_over] == truth.op[taken_over - 1]


def test_a_loop_that_does_not_compensate_acknowledges_and_changes_nothing(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    plain = 'fmu = "example1"\nsetpoint = [[0.0, 55.0]]'
    runs = []
    for block in (make_block(1), None):
        with VirtualPlc(make_site(plant=plain), "plc") as plc:
            writer = writer_of(plc)
            writer.run(200)
            if block is not None:
                writer.send(block)
            writer.run(100)
            assert writer.answer == ((1, 1) if block is not None else (0, 0))
            runs.append(plc.truth("FC101"))
    np.testing.assert_array_equal(runs[0].op, runs[1].op)
    assert not runs[0].compensated.any()


def test_an_expired_block_gives_the_loop_back_and_the_valve_notices_nothing(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(300)
        writer.send(make_block(1, valid_for=300))
        writer.run(301)
        supervisor = plc.supervisor("FC101")
        assert plc.truth("FC101").compensated[-2]
        writer.run(1)
        assert plc.block("FC101").fallback is Fallback.EXPIRED
        assert supervisor.state is SupervisorState.BASE
        assert supervisor.reason is WithdrawReason.EXPIRED
        writer.run(100)
        truth = plc.truth("FC101")
    assert not truth.compensated[-100:].any()
    # OP comes back from the middle of the band; the valve, and so PV, notices nothing.
    _, given_back = changeovers(truth)
    assert truth.stem[given_back] == truth.stem[given_back - 1]


def test_a_dead_heartbeat_suspends_and_a_living_one_resumes(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(300)
        writer.send(make_block(1))
        writer.run(100)
        supervisor = plc.supervisor("FC101")
        assert supervisor.compensating
        for _ in range(9):  # dead after 10 s
            plc.scan()
        assert supervisor.compensating
        for _ in range(2):
            plc.scan()
        assert not supervisor.compensating
        assert supervisor.reason is WithdrawReason.HEARTBEAT_DEAD
        writer.run(100)
        assert supervisor.compensating


def test_the_heartbeat_is_judged_by_the_wall_clock_of_a_faster_plant(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc", speed=50.0) as plc:
        writer = writer_of(plc)
        writer.run(3)
        writer.send(make_block(1))
        writer.run(1)
        for _ in range(499):
            plc.scan()
        assert plc.block("FC101").fallback is None
        plc.scan()
        assert plc.block("FC101").fallback is Fallback.HEARTBEAT_DEAD


def test_the_operator_s_enable_register_ends_compensation(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(300)
        writer.send(make_block(1))
        writer.run(100)
        assert plc.supervisor("FC101").compensating
        plc.enable("FC101", False)
        writer.run(1)
        assert not plc.supervisor("FC101").compensating
        assert plc.supervisor("FC101").reason is WithdrawReason.OPERATOR


def test_a_healthy_valve_needs_no_compensator(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(300)
        writer.send(make_block(1))
        writer.run(100)
        healthy = replace(make_block(2), status=Status.NO_STICTION)
        writer.send(healthy)
        writer.run(1)
        assert plc.supervisor("FC101").state is SupervisorState.BASE
        assert plc.supervisor("FC101").reason is WithdrawReason.NO_STICTION


def test_a_model_of_another_sampling_period_is_not_used(
    make_site: MakeSite, writer_of: Callable
) -> None:
    slow = LoopModel(ValveModel(11.0, 3.0), ProcessModel((-0.5,), (0.5,), 1, 0.0, 5.0))
    block = ParameterBlock.from_model(slow, loop_id=101, seq=1, valid_for=600, window_end_ms=0)
    with VirtualPlc(make_site(), "plc") as plc:
        writer = writer_of(plc)
        writer.run(100)
        writer.send(block)
        writer.run(100)
        assert not plc.truth("FC101").compensated.any()
        assert plc.supervisor("FC101").reason is WithdrawReason.REFUSED


def test_a_compensated_run_is_the_same_for_the_same_seed(
    make_site: MakeSite, make_block: MakeBlock, writer_of: Callable
) -> None:
    runs = []
    for _ in range(2):
        with VirtualPlc(make_site(), "plc") as plc:
            writer = writer_of(plc)
            writer.run(150)
            writer.send(make_block(1))
            writer.run(150)
            runs.append(plc.truth("FC101"))
    np.testing.assert_array_equal(runs[0].op, runs[1].op)
    np.testing.assert_array_equal(runs[0].stem, runs[1].stem)
