"""What holds until an operator decides, told once and not at every look."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["ToldOnce"]


class ToldOnce:
    """Remembers what has been told.

    Args:
        tell: called with kind and message of what an operator has to know.
    """

    def __init__(self, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._kinds: set[str] = set()

    def carry_over(self, other: ToldOnce) -> None:
        """Tell nothing again that another one has told."""
        self._kinds = other._kinds

    def tell(self, kind: str, message: str) -> None:
        """Tell a message unless its kind has been told already."""
        if kind not in self._kinds:
            self._kinds.add(kind)
            self._tell(kind, message)

    def forget(self, kind: str) -> None:
        """Let a kind be told again: its cause has ended."""
        self._kinds.discard(kind)

    def forget_all(self) -> None:
        """Let everything be told again: the operator has decided."""
        self._kinds.clear()
