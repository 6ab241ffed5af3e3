"""Pure register arithmetic: types and word orders, read plans, parameter blocks.

Nothing here opens, reads or waits: registers come in and go out as sequences of integers, time as a
number of seconds.
"""

from fieldlink.registers.block_layout import BLOCK_FIELDS, BLOCK_REGISTERS
from fieldlink.registers.block_reader import BlockLimits, BlockReader, Fallback, ReaderState
from fieldlink.registers.block_words import decode_block, encode_block
from fieldlink.registers.codes import (
    ACCEPTED,
    NOTHING_SEEN,
    BlockError,
    BlockFault,
    Refusal,
    Status,
    Verdict,
    describe_ack,
)
from fieldlink.registers.columns import read_back
from fieldlink.registers.decoder import BlockDecoder, pack_payload, unpack_payload
from fieldlink.registers.exchange import (
    Bank,
    ExchangeLayout,
    ExchangeWords,
    commit_word,
    split_commit,
)
from fieldlink.registers.heartbeat import HEARTBEAT_EVERY, HEARTBEAT_TIMEOUT
from fieldlink.registers.parameter_block import (
    Bounded,
    ParameterBlock,
    block_gain,
    is_newer,
    next_seq,
)
from fieldlink.registers.plan import Apart, PlanError, ReadRequest, find_apart, plan_reads
from fieldlink.registers.tag import DecodedValue, Tag, ValueQuality
from fieldlink.registers.types import (
    ORDERS,
    DataType,
    Order,
    RegisterValueError,
    Table,
)
from fieldlink.registers.words import decode, decode_text, encode, encode_text

__all__ = [
    "ACCEPTED",
    "BLOCK_FIELDS",
    "BLOCK_REGISTERS",
    "HEARTBEAT_EVERY",
    "HEARTBEAT_TIMEOUT",
    "NOTHING_SEEN",
    "ORDERS",
    "Apart",
    "Bank",
    "BlockDecoder",
    "BlockError",
    "BlockFault",
    "BlockLimits",
    "BlockReader",
    "Bounded",
    "DataType",
    "DecodedValue",
    "ExchangeLayout",
    "ExchangeWords",
    "Fallback",
    "Order",
    "ParameterBlock",
    "PlanError",
    "ReadRequest",
    "ReaderState",
    "Refusal",
    "RegisterValueError",
    "Status",
    "Table",
    "Tag",
    "ValueQuality",
    "Verdict",
    "block_gain",
    "commit_word",
    "decode",
    "decode_block",
    "decode_text",
    "describe_ack",
    "encode",
    "encode_block",
    "encode_text",
    "find_apart",
    "is_newer",
    "next_seq",
    "pack_payload",
    "plan_reads",
    "read_back",
    "split_commit",
    "unpack_payload",
]
