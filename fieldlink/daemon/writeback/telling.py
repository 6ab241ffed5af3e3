"""Messages that hold until an operator decides: each is reported once, not at every look."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["ToldOnce"]


class ToldOnce:
    """Remembers which kinds of messages were reported.

    Args:
        tell: called with kind and message of what an operator has to know.
    """

    def __init__(self, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._kinds: set[str] = set()

    def carry_over(self, other: ToldOnce) -> None:
        """Report nothing again that another one has reported."""
        self._kinds = other._kinds

    def tell(self, kind: str, message: str) -> None:
        """Report a message unless its kind was reported already."""
        if kind not in self._kinds:
            self._kinds.add(kind)
            self._tell(kind, message)

    def forget(self, kind: str) -> None:
        """Let a kind be reported again: its cause has ended."""
        self._kinds.discard(kind)

    def forget_all(self) -> None:
        """Let every kind be reported again: the operator has decided."""
        self._kinds.clear()
