"""``[mqtt]``: what the daemon publishes to a broker, and which commands it takes from there."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from fieldlink.site.base import Model, is_loopback

__all__ = ["MqttSettings", "MqttSpool", "MqttTls"]

PLAIN_PORT = 1883
TLS_PORT = 8883
"""The ports that IANA registers for MQTT without and with TLS."""

LONGEST_HOURS = 24 * 366
"""A year: what has waited longer is history, and the historian has it."""

Topic = Literal["estimates", "writebacks", "events", "findings", "health", "samples"]
Command = Literal["estimate_now", "withdraw"]


class MqttTls(Model):
    """``[mqtt.tls]``: certificates for the broker (PEM files)."""

    ca: Path
    """Certificates that may have signed the broker's own, relative to the site file."""
    cert: Path | None = None
    """Our certificate, where the broker asks for one."""
    key: Path | None = None
    """Private key of cert, without a password."""

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.cert is None) != (self.key is None):
            raise ValueError("cert and key belong together; give both or neither")
        return self


class MqttSpool(Model):
    """``[mqtt.spool]``: messages on disk that wait for the broker."""

    megabytes: float = Field(default=200.0, ge=1, le=1e6)
    """Size of the file above which the oldest messages are dropped."""
    hours: float = Field(default=72.0, gt=0, le=LONGEST_HOURS)
    """Age from which messages are dropped."""


def _default_port(keys: dict[str, Any]) -> int:
    return PLAIN_PORT if keys.get("tls") is None else TLS_PORT


class MqttSettings(Model):
    """``[mqtt]``: publishing to an MQTT broker; needs the extra mqtt."""

    host: str = Field(min_length=1)
    """Host name or address of the broker."""
    tls: MqttTls | None = None
    """Certificates; without them the connection is not encrypted."""
    port: int = Field(default_factory=_default_port, ge=1, le=0xFFFF)
    """TCP port; 8883 unless given with tls, else 1883."""
    username: str | None = None
    """User name for the broker."""
    password_file: Path | None = None
    """File with the password and nothing else, relative to the site file."""
    client_id: str | None = Field(default=None, min_length=1, max_length=60)
    """Client id, with -json or -sparkplug added; fieldlink and the site's name unless given."""
    formats: tuple[Literal["json", "sparkplug"], ...] = Field(
        default=("json", "sparkplug"), min_length=1
    )
    """Payloads: plain JSON on readable topics, Sparkplug B, or both."""
    publish: tuple[Topic, ...] = Field(
        default=("estimates", "writebacks", "events", "findings", "health"), min_length=1
    )
    """What is published; samples (every OP, PV and SP) only if named here."""
    topic: str = Field(default="fieldlink", min_length=1)
    """First level of the JSON topics: topic/site/area/loop/kind."""
    group: str | None = Field(default=None, min_length=1)
    """Sparkplug group id; the site's name unless given."""
    node: str = Field(default="fieldlink", min_length=1)
    """Sparkplug edge node id; each daemon of a group needs its own."""
    commands: tuple[Command, ...] = ()
    """Commands that are taken from the broker; none by default."""
    keepalive: int = Field(default=30, ge=5, le=3600)
    """Seconds of silence after which the broker is asked whether it is there."""
    spool: MqttSpool = MqttSpool()
    """Messages on disk that wait for the broker."""

    @property
    def is_local(self) -> bool:
        """Whether the broker is on this machine."""
        return is_loopback(self.host)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.username is None) != (self.password_file is None):
            raise ValueError("username and password_file belong together; give both or neither")
        if self.password_file is not None and self.tls is None and not self.is_local:
            raise ValueError(
                "the password would cross the network unencrypted; add the table tls with the "
                "broker's ca, or use a broker on this machine that forwards"
            )
        for name, reserved in (("topic", "+#\0"), ("group", "+#/\0"), ("node", "+#/\0")):
            value = getattr(self, name) or ""
            if found := sorted(set(value) & set(reserved)):
                raise ValueError(
                    f'{name} = "{value}" has the character {found[0]!r}, which MQTT reserves; '
                    "remove it"
                )
        if self.topic.startswith("$") or self.topic.strip("/") != self.topic:
            raise ValueError(
                f'topic = "{self.topic}" begins with $ or has a / at an end; remove it'
            )
        return self
