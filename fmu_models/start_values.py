"""Start values as a user gives them, by what the FMU takes them for: sizes, numbers and texts.

Where a variable takes numbers, the items of its enumeration, ``true`` and ``false`` stand for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .arrays import element_names, resolve_shape
from .errors import PlantInputError, PlantNameError
from .library import call_checked
from .variable_types import LEFT_OUT, REFERENCE_TYPES, STRING_TYPES, is_settable

__all__ = ["StartValue", "StartValues", "list_texts", "sort_start_values", "write_texts"]

StartValue = float | str
"""A number, or the text of a string variable, or a word for a number."""


@dataclass(frozen=True, slots=True)
class StartValues:
    """Start values by kind.

    Attributes:
        structural: of the parameters that decide the sizes of arrays.
        numbers: of all other numbers; names that the FMU does not have are here too.
        texts: of string variables, all elements of one in their order, by value reference.
    """

    structural: Mapping[str, float]
    numbers: Mapping[str, float]
    texts: Mapping[int, Sequence[bytes]]


def list_texts(description: Any) -> tuple[str, ...]:
    """Return the names of the strings that can be given before the start."""
    return tuple(
        name
        for v in description.modelVariables
        if v.type == "String" and is_settable(v)
        for name in _elements(v)
    )


def sort_start_values(description: Any, values: Mapping[str, StartValue]) -> StartValues:
    """Sort start values by kind.

    Args:
        description: FMPy's model description.
        values: by variable, or element of an array.

    Raises:
        PlantNameError: a variable that cannot be given: binary data, a clock, a string that is an
            output or is computed.
        PlantInputError: text where a number is needed or the other way round, a word that the
            variable does not have, or some elements only of an array of strings.
    """
    model = description.modelName
    owners = {name: v for v in description.modelVariables for name in _names_of(v)}
    structural: dict[str, float] = {}
    numbers: dict[str, float] = {}
    given: dict[int, dict[str, bytes]] = {}
    for name, value in values.items():
        variable = owners.get(name) or owners.get(name.rpartition("[")[0])
        if variable is None:
            numbers[name] = 0.0 if isinstance(value, str) else value
        elif variable.type == "String":
            _check_settable(model, name, variable)
            given.setdefault(variable.valueReference, {})[name] = _encode(model, name, value)
        elif variable.type in LEFT_OUT:
            what = "binary data" if variable.type == "Binary" else "a clock"
            raise PlantNameError(
                f"plant {model}: {name} is {what} and cannot be set; leave it out, it keeps its "
                "start value"
            )
        else:
            number = _as_number(model, name, variable, value)
            kind = structural if variable.causality == "structuralParameter" else numbers
            kind[name] = number
    texts = {
        reference: _whole(model, owners[next(iter(elements))], elements)
        for reference, elements in given.items()
    }
    return StartValues(structural, numbers, texts)


def write_texts(fmu: Any, version: int, texts: Mapping[int, Sequence[bytes]]) -> None:
    """Set string variables.

    Raises:
        FMICallException: the FMU refused.
    """
    if not texts:
        return
    parts = [text for elements in texts.values() for text in elements]
    references = (REFERENCE_TYPES[version] * len(texts))(*texts)
    values = (STRING_TYPES[version] * len(parts))(*parts)
    sizes = (len(parts),) if version == 3 else ()
    call_checked(
        fmu, f"fmi{version}SetString", fmu.component, references, len(texts), values, *sizes
    )


def _names_of(variable: Any) -> tuple[str, ...]:
    return _elements(variable) if variable.type == "String" else (variable.name,)


def _elements(variable: Any) -> tuple[str, ...]:
    if not variable.dimensions:
        return (variable.name,)
    return element_names(variable.name, resolve_shape(variable, {}))


def _check_settable(model: str, name: str, variable: Any) -> None:
    if not is_settable(variable):
        raise PlantNameError(
            f"plant {model}: {name!r} is {variable.causality} ({variable.variability}) and cannot "
            "be set; leave it out"
        )


def _encode(model: str, name: str, value: StartValue) -> bytes:
    if not isinstance(value, str):
        raise PlantInputError(
            f"plant {model}: {name} = {value:g} cannot be set; it takes text, give it in quotes"
        )
    try:
        content = value.encode("utf-8")
    except UnicodeEncodeError as error:
        raise PlantInputError(
            f"plant {model}: {name} cannot be set; its text is not UTF-8"
        ) from error
    if b"\0" in content:
        raise PlantInputError(
            f"plant {model}: {name} cannot be set; a text cannot hold the character NUL"
        )
    return content


def _as_number(model: str, name: str, variable: Any, value: StartValue) -> float:
    declared = variable.declaredType
    words = {item.name: float(item.value) for item in declared.items or ()} if declared else {}
    if not isinstance(value, str):
        if words and value not in words.values():
            known = ", ".join(f"{number:g} ({word})" for word, number in words.items())
            raise PlantInputError(
                f"plant {model}: {name} = {value:g} cannot be set; it must be one of {known}"
            )
        return value
    if variable.type == "Boolean":
        words = {"true": 1.0, "false": 0.0}
    if value not in words:
        known = f" or one of {', '.join(words)}" if words else ""
        raise PlantInputError(
            f"plant {model}: {name} = {value!r} cannot be set; it must be a number{known}"
        )
    return words[value]


def _whole(model: str, variable: Any, given: Mapping[str, bytes]) -> list[bytes]:
    names = _elements(variable)
    lacking = [name for name in names if name not in given]
    if lacking:
        raise PlantInputError(
            f"plant {model}: {variable.name} is an array of texts; give all its elements, "
            f"{', '.join(lacking)} too"
        )
    return [given[name] for name in names]
