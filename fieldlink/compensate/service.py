"""The compensator beside a real PLC: reads block, PV, SP and mode, computes OP, and may write it.

Nothing is written unless the site file enables it, the run was asked to write, the PLC's enable
bit is set, the block is in force and the loop is in automatic; and then only the loop's ``op_out``
tag, inside its limits and rate, starting from the OP that is there. To fall back is to stop
writing: the PLC's own controller, which tracks OP while a client writes it, then has the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack

from compensator import (
    Action,
    ActionStatus,
    Compensator,
    EmbeddingMpc,
    EmbeddingSettings,
    HybridMpc,
    HybridSettings,
    LoopMemory,
    OpLimits,
    Supervisor,
    Uncertainty,
    WithdrawReason,
)
from fieldlink.compensate.memory_file import (
    MemoryFileError,
    load_memory,
    only_writer,
    save_memory,
)
from fieldlink.compensate.offers import refusal_of, uncertainty_of
from fieldlink.compensate.op_watch import OpWatch
from fieldlink.compensate.verdicts import Step, Verdict, with_verdict
from fieldlink.compensate.wiring import (
    CompensateError,
    exchange_of,
    link_to,
    op_out_of,
    supervising,
)
from fieldlink.links import Clock, LinkError, RegisterAccess, Scan, SystemClock
from fieldlink.registers import (
    BLOCK_REGISTERS,
    Bank,
    BlockReader,
    ExchangeWords,
    Fallback,
    ParameterBlock,
    ReaderState,
    Refusal,
    RegisterValueError,
    commit_word,
)
from fieldlink.site import Loop, Site
from fieldlink.site.compensate import CompensateSettings
from loop_model import LoopModel

__all__ = ["CompensateError", "CompensateService", "Step", "Verdict"]


_NO_BLOCK = (0,) * BLOCK_REGISTERS

_KEEP_EVERY = 60
"""Scans between two writes of the memory at least, unless a model is given up."""

_LOOKS = "it follows the loop until it knows where the stem is, and the valve rests"

_GIVEN_UP_DRY = (
    " (in a dry run nothing moves the valve, so this says nothing of the model: with --write it is "
    "judged anew)"
)


class _PlcsOwn:
    """Stands for the controller in the PLC, which acts by itself."""

    def __init__(self) -> None:
        self._op = math.nan

    def observe(self, pv: float, op: float) -> None:  # noqa: ARG002
        """See `Controller.observe`."""
        self._op = op

    def decide(self, sp: float) -> Action:  # noqa: ARG002
        """See `Controller.decide`."""
        return Action(self._op, ActionStatus.HOLDING, detail="the PLC's own controller")


class CompensateService:
    """One loop; call `open`, then `step` once a period, then `close`.

    Args:
        site: the site.
        name: of the loop.
        write: whether OP may be written at all; without it every step is a dry run.
        clock: stamps readings.
        tell: called with what the operator has to know.

    Raises:
        CompensateError: the site file lacks what is needed, or forbids it.
        MemoryFileError: the file of an earlier run cannot be used.
    """

    def __init__(
        self,
        site: Site,
        name: str,
        *,
        write: bool = False,
        clock: Clock | None = None,
        tell: Callable[[str], None] = print,
    ) -> None:
        if name not in site.loops:
            raise CompensateError(f"there is no loop {name!r}; choose from {', '.join(site.loops)}")
        self.loop: Loop = site.loops[name]
        self._name = name
        self.settings: CompensateSettings = self.loop.compensate
        self._write = write
        self._op_out = op_out_of(site, self.loop)
        self._layout = exchange_of(name, self.loop)
        self._link = link_to(site, name, self._op_out, write=self.writes, clock=clock)
        if not isinstance(self._link, RegisterAccess):
            raise CompensateError(
                f"loop {name}: device {self.loop.device!r} has no registers; use a Modbus device"
            )
        self._access: RegisterAccess = self._link
        self._word_order = site.devices[self.loop.device].word_order
        self._reader = self._new_reader()
        self._speed = site.devices[self.loop.device].speed
        self._accepted_commit, self._enabled = 0, False
        limits = OpLimits(self.settings.low, self.settings.high, self.settings.rate)
        self._limits = limits
        self.supervisor = Supervisor(
            _PlcsOwn(), supervising(self.loop, self.settings, limits), self._builder(limits)
        )
        self._clock = clock or SystemClock()
        self._memory_file = site.resolve(self.settings.memory or f"{name}.compensator.json")
        self.supervisor.restore(
            load_memory(self._memory_file, name, period=self.loop.period, now=self._clock.utc())
        )
        self._kept = self.supervisor.memory
        self._known_before = len(self._kept.given_up)
        self._since_kept = 0
        self._tell, self._unkept = tell, False
        self._held = ExitStack()
        self._op_watch = OpWatch(limits.high - limits.low, self.supervisor.settings.pv_bad_limit)
        self._ignored = ""
        self._model: LoopModel | None = None
        self._followed_at: float | None = None
        self._last_op = self._last_sp = math.nan
        self._told: tuple[int, Refusal | None] = (0, None)
        self.writes_done = self._failed = 0

    @property
    def writes(self) -> bool:
        """Whether this run may write: the site file and the command line both say so."""
        return self._write and self.settings.enabled

    async def open(self) -> None:
        """Make the link ready.

        Raises:
            MemoryFileError: another process writes OP of this loop.
        """
        if self.writes:
            self._held.enter_context(only_writer(self._memory_file))
        await self._link.open()

    async def close(self) -> None:
        """Stop: nothing is written any more, and the PLC goes on by itself."""
        await self._link.close()
        if self.supervisor.memory != LoopMemory():
            self._keep_memory()
        self._held.close()

    async def step(self, now: float) -> Step:
        """Run one scan at ``now`` plant seconds, which never go back."""
        scan = await self._link.scan()
        pv, op = scan[self.loop.pv].value, scan[self.loop.op].value
        sp = scan[self.loop.sp].value if self.loop.sp is not None else math.nan
        try:
            block = self._reader.scan(await self._exchange_words(), now)
        except LinkError as error:
            return Step(Verdict.NOT_READ, pv, sp, op, math.nan, str(error))
        if not (math.isfinite(op) and math.isfinite(sp)):
            self._follow(block)
            words = str(scan.failures[0]) if scan.failures else "a value is out of range or NaN"
            return Step(Verdict.NOT_READ, pv, sp, op, math.nan, words)
        self._make_up_for_lost_scans(now, sp, op)
        self._follow(block)
        automatic = self._automatic(scan)
        self._heed_an_ignored_op(op)
        action = self.supervisor.step(pv, sp, op, automatic=automatic)
        if self._must_keep():
            self._keep_memory()
        untold = await self._tell_refusal(block)
        if not automatic:
            return Step(Verdict.MANUAL, pv, sp, op, math.nan, "")
        if block.model is None:
            words = "" if block.fallback is None else block.fallback.value
            disabled = block.fallback is Fallback.DISABLED
            verdict = Verdict.PLC_DISABLED if disabled else Verdict.NO_MODEL
            return Step(verdict, pv, sp, op, math.nan, words)
        if not self.supervisor.compensating:
            reason = self.supervisor.reason
            passing = _LOOKS if reason is WithdrawReason.NONE else reason.value
            why = self._ignored or self.supervisor.refusal or passing
            words = why + untold
            if len(self.supervisor.memory.given_up) > self._known_before and not self.writes:
                words += _GIVEN_UP_DRY
            return Step(Verdict.WAITING, pv, sp, op, math.nan, words)
        done = await self._put(Step(Verdict.DRY_RUN, pv, sp, op, action.op, action.detail))
        if done.verdict is Verdict.WRITTEN:
            self._op_watch.wrote(done.op)
        else:
            self._op_watch.wrote_nothing()
        self._failed = self._failed + 1 if done.verdict is Verdict.WRITE_FAILED else 0
        if self._failed > self.supervisor.settings.pv_bad_limit:
            # OP is the PLC's own then, and the model not to be judged by it: offered again.
            self.supervisor.withdraw(WithdrawReason.OPERATOR)
            self._model, self._failed = None, 0
        return done

    def _heed_an_ignored_op(self, op: float) -> None:
        """Let go of a loop whose PLC does not take OP: the model is not to blame for what follows.

        The next block is tried again, and so is this one after a restart.
        """
        if not self.supervisor.compensating:
            self._op_watch.wrote_nothing()
        elif not self._op_watch.look(op):
            self._ignored = (
                f"OP does not follow what is written to {self.settings.op_out}: let the PLC take "
                "OP from there in this mode, then start again"
            )
            self._tell(self._ignored)
            self.supervisor.withdraw(WithdrawReason.OPERATOR)

    def _make_up_for_lost_scans(self, now: float, sp: float, op: float) -> None:
        """Let the supervisor know of the scans since the last one, in which nothing was read.

        A few are scans of bad PV. After more the PLC's own controller has had the loop, and what it
        did with the stem is not known: the compensator finds it again before it takes over.
        """
        since, self._followed_at = self._followed_at, now
        before_sp, before_op, self._last_sp, self._last_op = self._last_sp, self._last_op, sp, op
        if since is None:
            return
        settings = self.supervisor.settings
        lost = round((now - since) / self.loop.period) - 1
        if lost > settings.pv_bad_limit and self._model is not None:
            self.supervisor.withdraw(WithdrawReason.PV_BAD)
            self._model = None  # offered again in this scan
        for _ in range(min(lost, 4 * settings.history)):
            self.supervisor.step(math.nan, before_sp, before_op)

    def _must_keep(self) -> bool:
        """Whether the memory has to be written now: a model was given up, or it is old.

        Under the PLC's own controller the figures change a little with every scan.
        """
        self._since_kept += 1
        memory = self.supervisor.memory
        if len(memory.given_up) > len(self._kept.given_up):
            return True
        return self._since_kept >= _KEEP_EVERY and memory != self._kept

    def _keep_memory(self) -> None:
        """Write the memory; not of a dry run, whose model is judged by what it did not do."""
        self._kept, self._since_kept = self.supervisor.memory, 0
        if not self.writes:
            return
        try:
            save_memory(
                self._memory_file,
                self._name,
                self._kept,
                period=self.loop.period,
                now=self._clock.utc(),
            )
        except MemoryFileError as error:
            # No reason to let go of the loop: the next one is written in a minute of scans.
            if not self._unkept:
                self._tell(f"{error}; a restart would begin with an older one")
            self._unkept = True
        else:
            self._unkept = False

    async def _put(self, step: Step) -> Step:
        low, high = self._limits.low, self._limits.high
        # The range before the rate, where OP was read a little outside.
        wanted = min(max(self._limits.clip(step.op, step.op_before), low), high)
        done = Step(step.verdict, step.pv, step.sp, step.op_before, wanted, step.detail)
        if not self.settings.enabled:
            return with_verdict(done, Verdict.NOT_ENABLED)
        if not self.writes:
            return done
        assert self._op_out is not None
        try:
            words = self._op_out.encode_inside(wanted, low, high)
            await self._access.write_registers(self._op_out.address, words)
        except (LinkError, RegisterValueError) as error:
            return with_verdict(done, Verdict.WRITE_FAILED, str(error))
        self.writes_done += 1
        held = self._op_out.decode(words).value  # what the register has made of it
        return Step(Verdict.WRITTEN, done.pv, done.sp, done.op_before, held, done.detail)

    async def _tell_refusal(self, block: ReaderState) -> str:
        """Write to the PLC why the accepted block's model is not used, once for each change.

        Written under the same conditions as OP: site file, run and the PLC's enable bit. Returns
        words on a write that failed; the next scan writes again.
        """
        address = self._layout.ack_refusal
        refusal = None if block.model is None else refusal_of(self.supervisor)
        told = (block.ack_seq, refusal)
        if address is None or told == self._told or not (self.writes and self._enabled):
            return ""
        try:
            await self._access.write_registers(address, [0 if refusal is None else refusal.code])
        except LinkError as error:
            return f"; the refusal could not be written: {error}"
        self._told = told
        return ""

    def _automatic(self, scan: Scan) -> bool:
        if self.loop.mode is None:
            return True
        return scan[self.loop.mode].value in self.loop.auto_values

    async def _exchange_words(self) -> ExchangeWords:
        """Read the exchange area, with the block that the PLC has accepted as the committed one.

        The PLC may refuse a block for what only it knows, such as its own limits, and it keeps over
        a restart which block it has: what it does not acknowledge is not used.
        """
        read, layout = self._access.read_registers, self._layout
        enable, heartbeat, ack_seq, active_bank = [
            (await read(address, 1))[0]
            for address in (layout.enable, layout.heartbeat, layout.ack_seq, layout.active_bank)
        ]
        self._enabled = bool(enable & 1)
        if ack_seq == 0 and self._accepted_commit:
            # What is newer is the PLC's to say: with its memory lost, every number is.
            self._reader, self._accepted_commit = self._new_reader(), 0
        if ack_seq == 0 or active_bank not in (Bank.A, Bank.B):
            return ExchangeWords(enable, heartbeat, 0, _NO_BLOCK, _NO_BLOCK)
        if self._enabled:
            # What is accepted while the operator forbids it is taken up when he allows it again.
            self._accepted_commit = commit_word(Bank(active_bank), ack_seq)
        bank_a, bank_b = [
            tuple(await read(layout.bank_address(bank), BLOCK_REGISTERS))
            for bank in (Bank.A, Bank.B)
        ]
        return ExchangeWords(enable, heartbeat, self._accepted_commit, bank_a, bank_b)

    def _new_reader(self) -> BlockReader:
        assert self.loop.writeback.loop_id is not None
        return BlockReader(
            self.loop.writeback.loop_id,
            word_order=self._word_order,
            heartbeat_timeout=self.settings.heartbeat_timeout,
            age=self._age,
        )

    def _age(self, block: ParameterBlock) -> float:
        """Return the plant seconds since a block's window ended: it may be of long ago."""
        return max(0.0, self._clock.utc() - 1e-3 * block.window_end_ms) * self._speed

    def _follow(self, block: ReaderState) -> None:
        """Tell the supervisor of a change of model, once."""
        model = block.model
        if model == self._model:
            return
        self._model, self._ignored = model, ""
        if model is not None and block.in_force is not None:
            self.supervisor.offer(model, uncertainty_of(block.in_force))
        elif block.fallback is Fallback.EXPIRED:
            self.supervisor.withdraw(WithdrawReason.EXPIRED)
        elif block.fallback is Fallback.HEARTBEAT_DEAD:
            self.supervisor.withdraw(WithdrawReason.HEARTBEAT_DEAD)
        else:
            self.supervisor.withdraw(WithdrawReason.OPERATOR)

    def _builder(self, limits: OpLimits) -> Callable[[LoopModel, Uncertainty], Compensator]:
        if self.settings.controller == "hybrid":
            return lambda model, stated: HybridMpc(model, HybridSettings(limits), stated)
        try:
            import casadi  # noqa: F401
        except ImportError as error:
            raise CompensateError(
                f'loop {self._name}: controller = "embedding" needs CasADi; run '
                'pip install "fieldlink[nlp]" or use controller = "hybrid"'
            ) from error
        return lambda model, _: EmbeddingMpc(model, EmbeddingSettings(limits=limits))
