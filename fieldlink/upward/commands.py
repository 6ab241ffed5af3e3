"""Commands from above: only those that the site file names, and each one recorded as an event."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from fieldlink.errors import FieldlinkError
from fieldlink.printable import as_printable

__all__ = ["Answer", "CommandDesk"]

Action = Callable[[str, str], None]
"""Carries a command out for a loop, with a reason; raises `FieldlinkError` to refuse it."""

Tell = Callable[..., None]
"""Records an event: kind, source, message, and ``bad`` where it is a warning."""

LONGEST_REASON = 200
"""Characters of a reason that are kept: one line of a screen."""

LONGEST_SHOWN = 300
"""Characters of a topic in an event: more than names of a site, an area and a loop take."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The outcome of a command: whether it was accepted, and a sentence."""

    accepted: bool
    message: str


class CommandDesk:
    """Checks commands and has them carried out.

    Args:
        allowed: the site file's ``mqtt.commands``.
        actions: what carries each command out.
        tell: records events.
    """

    def __init__(self, allowed: Collection[str], actions: Mapping[str, Action], tell: Tell) -> None:
        self._allowed = tuple(allowed)
        self._actions = actions
        self._tell = tell

    def handle(
        self,
        command: str,
        loop: str | None,
        reason: str,
        *,
        topic: str,
        refusal: str | None = None,
    ) -> Answer:
        """Carry a command out or refuse it; both are events.

        Args:
            command: its name in the site file.
            loop: the loop; None where the topic names none of the site's.
            reason: as the sender gave it.
            topic: where the command came from.
            refusal: why the message is not a command, found before it was read.
        """
        why = as_printable(reason)[:LONGEST_REASON] or "no reason given"
        try:
            if refusal is not None:
                raise FieldlinkError(refusal)
            if command not in self._allowed or command not in self._actions:
                raise FieldlinkError("the site file does not allow it; see mqtt.commands")
            if loop is None:
                raise FieldlinkError("the site has no such loop; check the topic")
            self._actions[command](loop, why)
        except FieldlinkError as error:
            return self._note(False, command, loop, why, topic, str(error))
        return self._note(True, command, loop, why, topic, "accepted")

    def _note(
        self, accepted: bool, command: str, loop: str | None, why: str, topic: str, said: str
    ) -> Answer:
        self._tell(
            "command.accepted" if accepted else "command.refused",
            loop or "mqtt",
            f"{as_printable(command)[:LONGEST_REASON]} over MQTT (topic "
            f"{as_printable(topic)[:LONGEST_SHOWN]}): {why}; {said}",
            bad=not accepted,
        )
        return Answer(accepted, said)
