"""A consumer and commander: paho-mqtt as another program would use it."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion


class Client:
    """Connected while the block runs; keeps what it receives as (topic, payload, retained)."""

    def __init__(self, port: int, *filters: str, client_id: str = "") -> None:
        self.received: list[tuple[str, bytes, bool]] = []
        self._port, self._filters = port, filters
        self._client: Any = paho.Client(CallbackAPIVersion.VERSION2, client_id=client_id)
        self._client.on_message = lambda *args: self.received.append(
            (args[2].topic, args[2].payload, args[2].retain)
        )
        self._subscribed = 0
        self._client.on_subscribe = lambda *_: setattr(self, "_subscribed", self._subscribed + 1)

    async def __aenter__(self) -> Self:
        from tests.upward.conftest import until

        self._client.connect("127.0.0.1", self._port)
        self._client.loop_start()
        await until(self._client.is_connected, "the other client's connection")
        for name in self._filters:
            self._client.subscribe(name, 1)
        await until(lambda: self._subscribed == len(self._filters), "its subscriptions")
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._client.disconnect()
        self._client.loop_stop()
        self._client.on_message = self._client.on_subscribe = None
        del self._client

    def publish(self, topic: str, payload: bytes | str, *, retain: bool = False) -> None:
        self._client.publish(topic, payload, 1, retain).wait_for_publish(10.0)
