"""What a status says of a loop's block and of the store."""

from __future__ import annotations

from fieldlink.daemon import DaemonStatus, LoopStatus, WritebackOutcome
from fieldlink.daemon.reporting.status_documents import live_status
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.outcomes import Attempt
from fieldlink.registers import ParameterBlock, Status
from fieldlink.store import StoreReport
from fieldlink.web.view.block_state import block_document


def reasons_with(block: ParameterBlock | None) -> tuple[str, str]:
    """What `fieldlink status` and the loop's page say after an accepted block."""
    accepted = Attempt(WritebackOutcome.ACCEPTED, "", Candidate.to_withdraw("test", 0.0))
    loop = LoopStatus(
        "plc",
        LoopCounts(),
        0.0,
        1,
        None,
        0,
        None,
        1,
        accepted,
        accepted,
        block=block,
        may_write=True,
    )
    (document,) = live_status(DaemonStatus({}, {"FC101": loop}, StoreReport()), 0.0)["loops"]
    return document["block"]["reason"], block_document(loop, None)["why"]


def test_a_block_that_the_plc_has_lost_is_not_called_accepted() -> None:
    for reason in reasons_with(None):
        assert "acknowledges none now" in reason
    healthy = ParameterBlock(loop_id=7, seq=2, status=Status.NO_STICTION, valid_for=60)
    for reason in reasons_with(healthy):
        assert reason == "the PLC has accepted the block"


def test_a_status_names_what_keeps_the_store_from_being_written() -> None:
    full = StoreReport(waiting=812, last_error="disk is full", failing=True)
    assert live_status(DaemonStatus({}, {}, full), 0.0)["store"] == {
        "failing": True, "reason": "disk is full", "waiting": 812, "lost": 0,
    }  # fmt: skip
    # The last failure is kept when it is over, and then it is none.
    over = StoreReport(last_error="disk is full")
    assert live_status(DaemonStatus({}, {}, over), 0.0)["store"]["reason"] == ""
