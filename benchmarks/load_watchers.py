"""Browsers and OPC UA clients that watch the daemon while `benchmarks.load` measures.

    python -m benchmarks.load_watchers PAGE BROWSERS OPCUA_PORT CLIENTS

Prints a line when everything is open, then looks until it is ended. Of the browsers' pages the
first shows the fleet, the second a loop with its live trend, the third the devices, and so on. Each
OPC UA client subscribes to health, verdict, stick band and block of every loop.
"""

from __future__ import annotations

import asyncio
import logging
import shutil
import sys
from typing import Any

from asyncua import Client
from playwright.async_api import async_playwright

__all__ = ["SUBSCRIBED"]

SUBSCRIBED = ("DeviceHealth", "Verdict", "StickBand", "BlockState")
"""What a screen of a control system would show of each loop."""

PATIENCE_MS = 120_000.0
INTERVAL_MS = 1000.0
WATCHDOG = 30.0
"""Seconds within which a server has to answer: asyncua's second is short for a busy machine."""

# A client that loses its server tells that in one line; asyncua would add a traceback a second.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)


async def _tell_lost(error: Exception) -> None:
    print(f"an OPC UA client has lost its connection: {error}", file=sys.stderr, flush=True)


class Taker:
    """Takes what the server reports."""

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """Part of asyncua's interface."""


async def subscribe(port: int) -> Client:
    """Return an OPC UA client that is subscribed to every loop."""
    client = Client(f"opc.tcp://127.0.0.1:{port}", timeout=60.0, watchdog_intervall=WATCHDOG)
    client.connection_lost_callback = _tell_lost
    await client.connect()
    loops = await client.get_node("ns=1;s=Loops").get_children()
    names = [f"ns=1;s={loop.nodeid.Identifier}/{name}" for loop in loops for name in SUBSCRIBED]
    subscription = await client.create_subscription(INTERVAL_MS, Taker())
    for begin in range(0, len(names), 500):
        nodes = [client.get_node(name) for name in names[begin : begin + 500]]
        await subscription.subscribe_data_change(nodes)
    return client


async def look(address: str, browsers: int, port: int, clients: int) -> None:
    """Open every page and keep it open."""
    async with async_playwright() as running:
        # A browser of its own each: pages of one browser would share its connections.
        for number in range(browsers):
            browser = await running.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox"]
            )
            page = await browser.new_page()
            page.set_default_timeout(PATIENCE_MS)
            await page.goto(address)
            await page.locator("#link", has_text="live ").wait_for()
            if number % 3 == 1:
                await page.locator("#fleet th a").first.click()
                await page.locator("#link", has_text="live ").wait_for()
            elif number % 3 == 2:
                await page.goto(f"{address}devices")
                await page.locator("#link", has_text="live ").wait_for()
        watching = [await subscribe(port) for _ in range(clients)]
        print(f"{browsers} browsers and {len(watching)} OPC UA clients look", flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(look(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])))
