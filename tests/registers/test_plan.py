from __future__ import annotations

import itertools

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fieldlink.registers import DataType, PlanError, ReadRequest, Table, Tag, find_apart, plan_reads
from fieldlink.registers.plan import ApartReason


def tag(name: str, address: int, kind: DataType = DataType.UINT16, table: str = "holding") -> Tag:
    return Tag(name, Table(table), address, kind)


def names(requests: tuple[ReadRequest, ...]) -> list[list[str]]:
    return [[found.name for found in request.tags] for request in requests]


def test_a_gap_up_to_the_limit_is_read_along() -> None:
    tags = [tag("a", 0), tag("b", 9), tag("c", 19)]
    requests = plan_reads(tags, max_gap=8)
    assert names(requests) == [["a", "b"], ["c"]]
    assert (requests[0].address, requests[0].count) == (0, 10)


def test_a_request_is_no_longer_than_max_registers() -> None:
    tags = [tag(f"t{i}", 2 * i, DataType.FLOAT32) for i in range(10)]
    requests = plan_reads(tags, max_registers=8)
    assert [request.count for request in requests] == [8, 8, 4]


def test_bits_have_the_limit_of_the_protocol() -> None:
    coils = [tag(f"c{i}", i, DataType.BOOL, "coil") for i in range(2001)]
    assert [request.count for request in plan_reads(coils, max_registers=10)] == [2000, 1]


def test_tables_are_never_mixed() -> None:
    tags = [tag("a", 0), tag("b", 1, table="input"), tag("c", 2)]
    assert names(plan_reads(tags)) == [["a", "c"], ["b"]]


def test_a_range_border_is_never_crossed() -> None:
    tags = [tag("a", 8), tag("b", 9), tag("c", 10)]
    assert names(plan_reads(tags, ranges=[(0, 9), (10, 19)])) == [["a", "b"], ["c"]]


def test_op_and_pv_share_a_request_across_a_gap_that_would_split_them() -> None:
    tags = [tag("op", 0), tag("pv", 100), tag("x", 50)]
    assert names(plan_reads(tags, max_gap=0)) == [["op"], ["x"], ["pv"]]
    assert names(plan_reads(tags, max_gap=0, together=[("op", "pv")])) == [["op", "x", "pv"]]


def test_interleaved_loops_get_overlapping_requests_rather_than_split_pairs() -> None:
    tags = [tag("op1", 0), tag("op2", 60), tag("pv1", 100), tag("pv2", 170)]
    groups = [("op1", "pv1"), ("op2", "pv2")]
    requests = plan_reads(tags, together=groups)
    assert names(requests) == [["op1", "pv1"], ["op2", "pv2"]]
    assert find_apart(requests, groups) == ()


@pytest.mark.parametrize(
    ("tags", "ranges", "reason"),
    [
        ([tag("op", 0), tag("pv", 0, table="input")], (), ApartReason.TABLES),
        ([tag("op", 0), tag("pv", 200)], (), ApartReason.TOO_FAR),
        ([tag("op", 0), tag("pv", 20)], [(0, 9), (10, 29)], ApartReason.RANGES),
    ],
)
def test_a_pair_that_no_request_can_hold_is_reported_with_the_reason(
    tags: list[Tag], ranges: list[tuple[int, int]], reason: ApartReason
) -> None:
    requests = plan_reads(tags, ranges=ranges, together=[("op", "pv")])
    (apart,) = find_apart(requests, [("op", "pv")], ranges=ranges)
    assert apart.reason is reason
    assert apart.tags == ("op", "pv")


def test_of_two_groups_that_share_a_tag_the_first_is_served() -> None:
    tags = [tag("op1", 0), tag("pv", 100), tag("op2", 200)]
    groups = [("op1", "pv"), ("op2", "pv")]
    requests = plan_reads(tags, together=groups)
    assert names(requests) == [["op1", "pv"], ["op2"]]
    (apart,) = find_apart(requests, groups)
    assert (apart.tags, apart.reason) == (("op2", "pv"), ApartReason.CROWDED)


def test_the_words_of_a_tag_are_found_in_the_answer() -> None:
    tags = [tag("a", 10), tag("b", 12, DataType.FLOAT32)]
    (request,) = plan_reads(tags)
    assert request.words_of(tags[1], [1, 2, 3, 4]) == [3, 4]


def test_a_tag_outside_the_ranges_is_refused() -> None:
    with pytest.raises(PlanError, match=r"b: holding 9 to 10 is not inside .*\(0, 9\)"):
        plan_reads([tag("a", 0), tag("b", 9, DataType.FLOAT32)], ranges=[(0, 9)])


def test_a_tag_longer_than_a_request_is_refused() -> None:
    with pytest.raises(PlanError, match="longer than max_registers = 3"):
        plan_reads([tag("a", 0, DataType.FLOAT64)], max_registers=3)


def test_a_group_of_unknown_tags_is_refused() -> None:
    with pytest.raises(PlanError, match="keep together: pv"):
        plan_reads([tag("op", 0)], together=[("op", "pv")])


@st.composite
def maps(draw: st.DrawFn) -> list[Tag]:
    places = draw(
        st.lists(
            st.tuples(
                st.sampled_from([Table.HOLDING, Table.INPUT]),
                st.integers(0, 400),
                st.sampled_from([DataType.UINT16, DataType.FLOAT32, DataType.INT64]),
            ),
            min_size=1,
            max_size=40,
        )
    )
    return [Tag(f"t{i}", *place) for i, place in enumerate(places)]


@st.composite
def borders(draw: st.DrawFn) -> list[tuple[int, int]]:
    cuts = sorted(draw(st.sets(st.integers(1, 403), max_size=4)))
    return [(first, last - 1) for first, last in itertools.pairwise([0, *cuts, 404])]


@given(
    tags=maps(),
    ranges=borders(),
    max_gap=st.integers(0, 20),
    max_registers=st.integers(4, 125),
    picks=st.lists(st.lists(st.integers(0, 39), min_size=2, max_size=3), max_size=6),
)
def test_every_tag_is_read_once_within_all_limits(
    tags: list[Tag],
    ranges: list[tuple[int, int]],
    max_gap: int,
    max_registers: int,
    picks: list[list[int]],
) -> None:
    tags = [t for t in tags if any(lo <= t.address and t.end <= hi + 1 for lo, hi in ranges)]
    assume(tags)
    groups = [[tags[i % len(tags)].name for i in pick] for pick in picks]
    requests = plan_reads(tags, max_gap, max_registers, ranges, together=groups)

    assert sorted(t.name for r in requests for t in r.tags) == sorted(t.name for t in tags)
    for request in requests:
        assert request.count <= max_registers
        assert any(lo <= request.address and request.end <= hi + 1 for lo, hi in ranges)
        for member in request.tags:
            assert member.table is request.table
            assert request.address <= member.address
            assert member.end <= request.end

    place = {t.name: number for number, r in enumerate(requests) for t in r.tags}
    split = [tuple(group) for group in groups if len({place[name] for name in group}) > 1]
    assert [apart.tags for apart in find_apart(requests, groups, max_registers, ranges)] == split


@given(tags=maps(), max_gap=st.integers(0, 20))
def test_without_groups_no_request_holds_a_longer_gap(tags: list[Tag], max_gap: int) -> None:
    for request in plan_reads(tags, max_gap):
        reach = request.address
        for member in sorted(request.tags, key=lambda member: member.address):
            assert member.address - reach <= max_gap
            reach = max(reach, member.end)


@given(tags=maps(), pair=st.tuples(st.integers(0, 39), st.integers(0, 39)))
def test_one_pair_that_fits_a_request_is_never_split(
    tags: list[Tag], pair: tuple[int, int]
) -> None:
    op, pv = (tags[i % len(tags)] for i in pair)
    assume(op.table is pv.table)
    assume(max(op.end, pv.end) - min(op.address, pv.address) <= 125)
    requests = plan_reads(tags, together=[(op.name, pv.name)])
    assert find_apart(requests, [(op.name, pv.name)]) == ()
