"""What a command shows while it works: on a terminal, on stderr, and nothing elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["show_work"]


@contextmanager
def show_work(doing: str) -> Iterator[Callable[[str], None]]:
    """Show what is being done; the function it gives says what is done next."""
    from rich.console import Console

    from fieldlink.printable import as_printable

    console = Console(stderr=True, highlight=False, markup=False)
    with console.status(doing) as status:
        yield lambda text: status.update(as_printable(text))
