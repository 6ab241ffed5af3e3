from __future__ import annotations

import asyncio
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldlink.links.backoff import Backoff, BackoffSettings, describe_next
from fieldlink.links.turns import Turns


async def test_urgent_waiters_overtake_and_equals_keep_their_order() -> None:
    turns, order = Turns(), []

    async def use(name: str, urgent: bool) -> None:
        async with turns.take(urgent=urgent):
            order.append(name)

    wanted = (("a", False), ("b", True), ("c", False), ("d", True))
    async with turns.take():
        tasks = [asyncio.create_task(use(name, urgent)) for name, urgent in wanted]
        await asyncio.sleep(0)
    await asyncio.gather(*tasks)
    assert order == ["b", "d", "a", "c"]


async def test_a_waiter_cancelled_as_its_turn_comes_hands_it_on() -> None:
    turns = Turns()

    async def use() -> str:
        async with turns.take():
            return "used"

    async with turns.take():
        first, second = asyncio.create_task(use()), asyncio.create_task(use())
        await asyncio.sleep(0)
    # The turn is on its way to the first waiter in this very moment.
    first.cancel()
    assert await second == "used"
    assert first.cancelled()
    async with asyncio.timeout(1.0):
        assert await use() == "used"


@given(st.integers(min_value=1, max_value=60), st.integers())
def test_pauses_grow_to_the_cap_and_no_further(failures: int, seed: int) -> None:
    settings = BackoffSettings(first=0.1, cap=5.0, jitter=0.3)
    backoff = Backoff(settings, rng=random.Random(seed))
    for _ in range(failures):
        backoff.failed(100.0)
    whole = min(5.0, 0.1 * 2.0 ** (failures - 1))
    assert 0.7 * whole - 1e-9 <= backoff.remaining(100.0) <= whole + 1e-9
    assert backoff.remaining(200.0) == 0.0


def test_a_success_forgets_the_failures() -> None:
    backoff = Backoff()
    backoff.failed(0.0)
    backoff.succeeded()
    assert backoff.remaining(0.0) == 0.0


@pytest.mark.parametrize("values", [{"first": 0.0}, {"first": 2.0, "cap": 1.0}, {"jitter": 1.0}])
def test_settings_that_make_no_sense_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="backoff needs"):
        BackoffSettings(**values)


@pytest.mark.parametrize(
    ("wait", "said"), [(0.3, "in 0.3 s"), (0.04, "at once"), (0.0, "at once"), (0.05, "in 0.1 s")]
)
def test_a_wait_of_no_time_is_said_in_words(wait: float, said: str) -> None:
    assert describe_next(wait, 3) == f"next attempt {said} (failures in a row: 3)"
