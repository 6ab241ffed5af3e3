"""What waits for an event until a deadline."""

from __future__ import annotations

import asyncio

from fieldlink.daemon.sampling.tasks import wait_for


async def test_what_is_set_in_the_turn_in_which_time_is_over_is_not_lost() -> None:
    asked = asyncio.Event()
    waiting = asyncio.create_task(wait_for(asked, 0.0))
    # Runs after the waiting has begun and before its deadline is looked at.
    asyncio.get_running_loop().call_soon(asked.set)
    assert await waiting


async def test_what_is_not_set_is_waited_for_until_the_deadline() -> None:
    assert not await wait_for(asyncio.Event(), 0.0)
