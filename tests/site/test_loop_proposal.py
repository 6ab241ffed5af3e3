"""Which loops the names of tags tell, as makers and plants write them."""

from __future__ import annotations

import pytest

from fieldlink.registers import DataType, Table, Tag
from fieldlink.site.loop_proposal import LoopProposal, Proposal, propose_loops


def proposed(*names: str, text: str = "") -> Proposal:
    tags = [
        Tag(name, Table.HOLDING, 2 * number, DataType.FLOAT32) for number, name in enumerate(names)
    ]
    if text:
        tags.append(Tag(text, Table.HOLDING, 500, DataType.STRING, length=4))
    return propose_loops(tags)


@pytest.mark.parametrize(
    ("op", "pv", "loop"),
    [
        ("FC101.OP", "FC101.PV", "FC101"),
        ("FIC101_OUT", "FIC101_PV", "FIC101"),
        ("PIC-12/MV", "PIC-12/PV", "PIC_12"),
        ("OP_FC101", "PV_FC101", "FC101"),
        ("FC101OP", "FC101PV", "FC101"),
        ("FC101 Stellgröße", "FC101 Istwert", "FC101"),
        ("Unit3.FC101.OP", "Unit3.FC101.PV", "Unit3_FC101"),
    ],
)
def test_names_as_plants_write_them(op: str, pv: str, loop: str) -> None:
    assert proposed(op, pv).loops == (LoopProposal(loop, {"op": op, "pv": pv}),)


def test_the_plainest_word_is_taken_and_equal_ones_are_left_to_a_person() -> None:
    (plain,) = proposed("FC1.OP", "FC1.VALVE", "FC1.PV").loops
    assert plain.roles["op"] == "FC1.OP"
    (unclear,) = proposed("FC1.OUT", "FC1.MV", "FC1.PV").loops
    assert unclear.unclear == {"op": ("FC1.OUT", "FC1.MV")}


def test_cv_means_two_things_and_is_asked_for() -> None:
    (as_output,) = proposed("FC1.CV", "FC1.PV").loops
    assert as_output.unclear == {"op": ("FC1.CV",)}
    (as_measured,) = proposed("FC1.MV", "FC1.CV").loops
    assert as_measured.unclear == {"pv": ("FC1.CV",)}


def test_an_output_and_a_measurement_of_one_number_are_asked_for() -> None:
    (loop,) = proposed("FV101.OP", "FT101.PV").loops
    assert (loop.roles, loop.unclear) == ({"op": "FV101.OP"}, {"pv": ("FT101.PV",)})
    found = proposed("FV101.OP", "FT101.PV", "TT101.PV")
    assert found.loops == ()
    assert {half.name for half in found.halves} == {"FV101", "FT101", "TT101"}


def test_text_is_no_signal() -> None:
    assert proposed("FC1.OP", text="FC1.PV").loops == ()


def test_the_letters_of_din_19226_are_taken_where_they_stand_together() -> None:
    (loop,) = proposed("FIC101.Y", "FIC101.X", "FIC101.W", "FIC101.A").loops
    assert loop.roles == {"op": "FIC101.Y", "pv": "FIC101.X", "sp": "FIC101.W"}
    (pair,) = proposed("FIC101_X", "FIC101_Y").loops
    assert pair == LoopProposal("FIC101", {"op": "FIC101_Y", "pv": "FIC101_X"})
    (disturbed,) = proposed("FIC1.X", "FIC1.Y", "FIC1.W", "FIC1.Z").loops
    assert set(disturbed.roles) == {"op", "pv", "sp"}


def test_letters_alone_or_of_coordinates_are_no_loop() -> None:
    for names in (("A.X",), ("A.X", "A.W"), ("X", "Y", "W"), ("R1.X", "R1.Y", "R1.Z"),
                  ("A.X", "B.Y"), ("X_PV", "Y_PV")):  # fmt: skip
        assert proposed(*names).loops == (), names
    (plain,) = proposed("FC1.OP", "FC1.PV", "FC1.X", "FC1.Y", "FC1.W").loops
    assert plain.roles == {"op": "FC1.OP", "pv": "FC1.PV"}
