"""Values in the columns of a Parquet file: numbers, times, modes and qualities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.assess.errors import ReadingError
from fieldlink.site.number_cells import is_bad_value, parse_numbers
from fieldlink.site.quality_codes import find_good
from fieldlink.site.recorded_columns import is_own_export, means_automatic

__all__ = ["good_rows", "numbers_in", "seconds_in", "switch_in"]

Floats = NDArray[np.float64]


def seconds_in(column: Any, unit: float) -> Floats:
    """A time column as seconds; since 1970 when it holds moments.

    Args:
        column: timestamps, dates, durations or numbers.
        unit: how many of what numbers count a second has.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        stamps = pc.cast(pc.cast(column, pa.timestamp("us"), safe=False), pa.int64())
        return _float64(stamps) / 1e6
    if pa.types.is_duration(kind):
        return _float64(pc.cast(pc.cast(column, pa.duration("us"), safe=False), pa.int64())) / 1e6
    if not _is_number(kind):
        raise ReadingError(
            f"its times are of type {kind}; store them as timestamps, or as seconds since 1970"
        )
    return _float64(column) / unit


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    return bool(
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    )


def _float64(column: Any) -> Floats:
    """Numbers as an array, NaN for null."""
    import pyarrow as pa

    numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return np.asarray(numbers, dtype=np.float64)


def numbers_in(column: Any, name: str) -> Floats:
    """A column of values as an array that may be changed, NaN for null and words for bad values.

    Raises:
        ReadingError: it holds something else than numbers.
    """
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
        column = column.cast(kind)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return _numbers_in_text(column, name)
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    elif not (_is_number(kind) or pa.types.is_null(kind)):
        raise ReadingError(f"its column {name} is of type {kind}; store numbers")
    return np.array(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _numbers_in_text(column: Any, name: str) -> Floats:
    """Numbers among words such as ``Bad``, which tables of a historian's values hold as text."""
    cells = ["" if cell is None else cell.strip() for cell in column.to_pylist()]
    found = parse_numbers(cells, comma_separates=False)
    odd = next((cells[index] for index in found.wrong), found.ambiguous)
    if odd is not None:
        raise ReadingError(
            f"its column {name} holds the text {odd!r}, which is not a number; store numbers, and "
            "null for a bad value"
        )
    return found.values


def switch_in(column: Any, name: str, *, is_guessed: bool) -> tuple[Floats | None, str | None]:
    """Return a column of yes and no as 1 and 0, NaN where it has none; and a note.

    A column that is only guessed to be one counts when it holds words: of a number alone it is not
    known which mode it means.
    """
    import pyarrow as pa

    codes, words = _coded(column)
    is_number = _is_number(column.type)
    states = [None if is_number else means_automatic(word) for word in words]
    known = all(
        state is not None or is_bad_value(word) for state, word in zip(states, words, strict=True)
    )
    if known and not is_number:
        values = [np.nan if state is None else float(state) for state in states]
        return np.array([*values, np.nan])[codes], None
    if is_guessed and not pa.types.is_null(column.type):
        return None, f"{name} is left out: name it with --auto if 1 means automatic there"
    return numbers_in(column, name), None


def good_rows(column: Any, header: Sequence[str]) -> NDArray[np.bool_] | None:
    """Return whether a column of quality calls each row good; None where that is not known."""
    codes, words = _coded(column)
    if is_own_export(header):
        good: NDArray[np.bool_] | None = np.array([word == "0" for word in words], dtype=np.bool_)
    else:
        good = find_good(words)
    return None if good is None else np.append(good, False)[codes]


def _coded(column: Any) -> tuple[NDArray[np.int64], list[str]]:
    """The different cells of a column as text, and which of them is in each row, -1 for null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if isinstance(column, pa.ChunkedArray):
        column = column.combine_chunks()
    coded = pc.dictionary_encode(column)
    words = [str(word).strip() for word in coded.dictionary.cast(pa.string()).to_pylist()]
    return np.asarray(coded.indices.fill_null(-1), dtype=np.int64), words
