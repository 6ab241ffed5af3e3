"""One writer a block: an installation notices another one, and neither writes blocks then.

The register ``writer`` holds the identity of the installation that writes. One that finds a foreign
identity watches its heartbeat: when that counts, the other one lives; when it stands still for as
long as readers allow, its place is free. Where there is no such register, or two installations have
one identity (a copied data directory), two writers still betray themselves by one heartbeat that
counts faster than either of them beats.
"""

from __future__ import annotations

from enum import Enum

from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.registers import HEARTBEAT_TIMEOUT

__all__ = ["SoleWriter", "Standing"]

DOUBT = HEARTBEAT_TIMEOUT
"""Plant seconds for which another identity has to be read: as long as its life would be watched.

Only a writer takes a true one away, and we do not write meanwhile: what is gone by itself was a
wrong reading, as from a gateway that has lost its PLC.
"""

STRANGE_BEATS = 2
"""Looks in a row with a heartbeat that is not ours; one may be a write that came late."""


class Standing(Enum):
    """Whether this installation may write; the value says why not."""

    SOLE = ""
    DOUBTED = "another writer's identity is read; it is watched for ten seconds first"
    WATCHING = "another installation wrote here; its heartbeat is watched for ten seconds first"
    CONTESTED = (
        "another installation, or the PLC's own program, writes Fieldlink's registers of this loop"
    )


class SoleWriter:
    """Watches the identity and the heartbeat of one exchange area.

    Args:
        identity: of this installation, 1 to 65535; None where it has none.

    Attributes:
        standing: whether this installation may write, by the last look.
    """

    def __init__(self, identity: int | None) -> None:
        self._identity = identity
        self._claimed = False
        self._watched: tuple[int, float] | None = None
        self._replaced: int | None = None
        self._beats: tuple[int, ...] = ()
        self._strange = 0
        self._unkept_since: float | None = None
        self._objected = False
        self._doubted_since: float | None = None
        self._foreign = 0
        self.standing = Standing.WATCHING

    @property
    def beats(self) -> bool:
        """Whether this installation keeps the heartbeat: the one that was first goes on with it."""
        return self._claimed

    @property
    def relief(self) -> str:
        """Say what was doubted, and that it is gone."""
        return (
            f"writer {self._foreign} was read, as if another installation wrote, and is gone "
            "again; blocks go on; look at the gateway or network between"
        )

    def look(self, control: ControlWords, now: float) -> Standing:
        """Judge what was read at plant second ``now``."""
        self._watch_own(control, now)
        if self.standing is Standing.CONTESTED:
            return self.standing
        if control.writer == self._identity:
            self._replaced = None
        foreign = self._identity is not None and control.writer not in (
            0,
            None,
            self._identity,
            self._replaced,
        )
        if foreign and not self._claimed:
            self.standing = self._watch(control.heartbeat, now)
            if self.standing is Standing.SOLE:
                # Its identity may still be read until ours is there.
                self._replaced = control.writer
            return self.standing
        self._claimed = True
        if self._beats and not foreign:
            ours = control.heartbeat == 0 or control.heartbeat in self._beats
            self._strange = 0 if ours else self._strange + 1
        if not foreign:
            self._doubted_since = None
        if self._strange >= STRANGE_BEATS:
            self.standing = Standing.CONTESTED
        elif foreign:
            self._foreign = control.writer or 0
            self.standing = self._doubted(now)
        else:
            self.standing = Standing.SOLE
        return self.standing

    def mark(self, control: ControlWords) -> int | None:
        """Return the identity when it is to be written now; None when it is not.

        It is written once as an objection, so that the other installation sees it as well.
        """
        if control.writer is None or self._identity is None:
            return None
        if self.standing is Standing.SOLE:
            return None if control.writer == self._identity else self._identity
        if self.standing is Standing.CONTESTED and not self._objected:
            self._objected = True
            return self._identity
        return None

    def next_beat(self, control: ControlWords) -> int:
        """Return the heartbeat to write; the one before it may still be there at the next look."""
        beat = (control.heartbeat + 1) & 0xFFFF
        self._beats = (control.heartbeat, beat)
        return beat

    def start_again(self) -> None:
        """Forget what was found: the operator has decided."""
        self._claimed, self._watched, self._replaced = False, None, None
        self._beats, self._strange, self._objected = (), 0, False
        self._unkept_since = None
        self._doubted_since = None
        self.standing = Standing.WATCHING

    def is_unheard(self, now: float) -> bool:
        """Whether the register has not kept our beats for so long that readers call us dead."""
        since = self._unkept_since
        return since is not None and now - since > HEARTBEAT_TIMEOUT

    def _watch_own(self, control: ControlWords, now: float) -> None:
        # Nothing is written without the enable bit, so nothing has to be kept then. A register that
        # another writer counts up is alive for the reader, though it does not keep our beats.
        stands_still = bool(self._beats) and control.heartbeat == self._beats[0]
        if not control.enabled or not stands_still:
            self._unkept_since = None
        elif self._unkept_since is None:
            self._unkept_since = now

    def _doubted(self, now: float) -> Standing:
        """Tell another writer from a register that was read wrong for a moment."""
        if self._doubted_since is None:
            self._doubted_since = now
        return Standing.CONTESTED if now - self._doubted_since >= DOUBT else Standing.DOUBTED

    def _watch(self, heartbeat: int, now: float) -> Standing:
        """Tell a living installation from one that is gone by its heartbeat."""
        if self._watched is None:
            self._watched = (heartbeat, now)
        before, since = self._watched
        if heartbeat != before:
            return Standing.CONTESTED
        if now - since < HEARTBEAT_TIMEOUT:
            return Standing.WATCHING
        self._claimed = True
        return Standing.SOLE
