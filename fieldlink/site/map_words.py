"""The words that vendors use in register lists, and what they mean in a register map."""

from __future__ import annotations

import re
from collections.abc import Mapping

__all__ = ["column_of", "fold", "meaning_of", "says_hexadecimal"]

_COLUMNS: Mapping[str, str] = {
    "tag": "tag tagname name signal signalname point pointname variable variablename symbol "
    "parameter parametername registername bezeichnung",
    "table": "table registertype area objecttype function functioncode fc modbusfunction "
    "memoryarea modbustype regtype",
    "address": "address addr register registeraddress registernumber registerno reg regno "
    "modbusaddress modbusregister startaddress startregister adresse modbusadresse "
    "registeradresse registernummer",
    "type": "type datatype format dataformat vartype valuetype datentyp",
    "bit": "bit bitno bitnumber bitposition",
    "length": "length registers numberofregisters noofregisters count words size quantity qty",
    "order": "order byteorder wordorder endianness endian",
    "scale": "scale factor gain multiplier scalefactor scaling resolution faktor",
    "divisor": "divisor divider divideby dividedby div teiler",
    "decimals": "decimals decimalplaces decimalpoints noofdecimals numberofdecimals "
    "implieddecimals nachkommastellen dezimalstellen kommastellen",
    "offset": "offset bias",
    "raw_low": "rawlow rawmin rawminimum",
    "raw_high": "rawhigh rawmax rawmaximum",
    "eng_low": "englow engmin scaledlow scaledmin",
    "eng_high": "enghigh engmax scaledhigh scaledmax",
    "unit": "unit units eu engunit engunits engineeringunit engineeringunits einheit",
    "low": "low min minimum lowlimit rangelow lowerlimit",
    "high": "high max maximum highlimit rangehigh upperlimit",
    "range": "range valuerange datarange bereich wertebereich messbereich",
    "outside": "outside",
    "invalid": "invalid invalidvalue invalidvalues notavailable",
    "writable": "writable writeable access accessrights accesstype rw readwrite zugriff",
    "read_only": "readonly",
    "every": "every pollinterval pollperiod interval",
    "comment": "comment comments description remark remarks note notes beschreibung bemerkung "
    "bemerkungen kommentar",
}

_MEANINGS: Mapping[str, Mapping[str, str]] = {
    "table": {
        "holding": "holding holdingregister holdingregisters hr hreg 4x 3 03 fc3 fc03 4 registers",
        "input": "input inputregister inputregisters ir ireg 3x fc4 fc04 04",
        "coil": "coil coils do digitaloutput 0x 1 01 fc1 fc01",
        "discrete": "discrete discreteinput discreteinputs di digitalinput 1x 2 02 fc2 fc02 "
        "inputstatus",
    },
    "type": {
        "int16": "int16 s16 i16 sint16 short int signed signed16 integer",
        "uint16": "uint16 u16 word uint ushort unsigned unsigned16",
        "int32": "int32 s32 i32 sint32 dint long signed32 longint",
        "uint32": "uint32 u32 dword udint ulong unsigned32",
        "int64": "int64 s64 i64 lint signed64",
        "uint64": "uint64 u64 ulint qword lword unsigned64",
        "float32": "float32 float real f32 single ieee754 float32bit ieee754float",
        "float64": "float64 double lreal f64",
        "bool": "bool boolean bit digital binary",
        "bcd16": "bcd16 bcd",
        "bcd32": "bcd32",
        "string": "string ascii char text str",
    },
    "order": {
        "ABCD": "abcd big bigendian be msb msbfirst",
        "CDAB": "cdab wordswap wordswapped swapped littleword",
        "BADC": "badc byteswap byteswapped",
        "DCBA": "dcba little littleendian le lsb lsbfirst",
    },
    "writable": {
        "yes": "yes true 1 rw wr w write readwrite wo writeonly x",
        "no": "no false 0 r ro read readonly",
    },
}


def fold(text: str) -> str:
    """Return ``text`` in lower case with letters and digits only."""
    return re.sub(r"[^a-z0-9]", "", text.lower())


def column_of(heading: str) -> str | None:
    """Return the column of a register map that a heading means, None when it means none."""
    # "Address (dec)" and "Scale [V]" mean what stands before the bracket.
    folded = fold(re.split(r"[(\[]", heading)[0])
    return _FOLDED_COLUMNS.get(folded)


def says_hexadecimal(heading: str) -> bool:
    """Whether a heading says that numbers below it are hexadecimal: ``Address (hex)``."""
    return re.search(r"(?<![a-z])hex(?:ade[cz]imal)?(?![a-z])", heading.lower()) is not None


def meaning_of(column: str, cell: str) -> str:
    """Return a cell in the register map's own words where they are known, else as it is."""
    return _FOLDED_MEANINGS.get(column, {}).get(fold(cell), cell)


def _inverted(words: Mapping[str, str]) -> dict[str, str]:
    return {word: meaning for meaning, known in words.items() for word in known.split()}


_FOLDED_COLUMNS = _inverted(_COLUMNS)
_FOLDED_MEANINGS = {column: _inverted(words) for column, words in _MEANINGS.items()}
