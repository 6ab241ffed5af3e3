"""Names of the plant as levels of a topic.

The characters that MQTT reserves are written as in a URL (``A/B`` becomes ``A%2FB``), so that two
names never share a topic.
"""

from __future__ import annotations

from fieldlink.site import Site

__all__ = ["JsonTopics", "as_level"]

_RESERVED = str.maketrans({"%": "%25", "/": "%2F", "+": "%2B", "#": "%23"})


def as_level(name: str) -> str:
    """Return a name as one level of a topic."""
    return name.translate(_RESERVED)


class JsonTopics:
    """The JSON topics of a site.

    Args:
        site: the site; must have a table ``[mqtt]``.
    """

    def __init__(self, site: Site) -> None:
        assert site.file.mqtt is not None
        self._base = f"{site.file.mqtt.topic}/{as_level(site.name)}"
        self.loops = {
            name: f"{self._base}/{as_level(loop.area)}/{as_level(name)}"
            for name, loop in site.loops.items()
        }
        self._loop_of = {topic: name for name, topic in self.loops.items()}

    @property
    def events(self) -> str:
        """Topic of all events of the site."""
        return f"{self._base}/events"

    def finding(self, number: str) -> str:
        """Topic of one finding of the site, from its birth to its end."""
        return f"{self._base}/findings/{as_level(number)}"

    @property
    def health(self) -> str:
        """Topic of the site's health."""
        return f"{self._base}/health"

    @property
    def online(self) -> str:
        """Topic that says whether the daemon is connected."""
        return f"{self._base}/online"

    @property
    def commands(self) -> str:
        """Filter of all commands to the site's loops."""
        return f"{self._base}/+/+/command/+"

    def of_kind(self, loop: str, kind: str) -> str | None:
        """Return the topic of a loop's messages of a kind; None for an unknown loop."""
        topic = self.loops.get(loop)
        return None if topic is None else f"{topic}/{kind}"

    def find_command(self, topic: str) -> tuple[str | None, str]:
        """Return the loop (None when unknown) and the command that a topic names."""
        prefix, _, command = topic.rpartition("/")
        return self._loop_of.get(prefix.removesuffix("/command")), command
