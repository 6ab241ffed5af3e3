"""From a TOML file to a checked model: every problem with its line, its key and its remedy."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from fieldlink.printable import quoted
from fieldlink.site.errors import Problem, SiteError, nearest
from fieldlink.site.toml_source import TomlSource

__all__ = ["validated"]

M = TypeVar("M", bound=BaseModel)


def validated(source: TomlSource, root: type[M]) -> M:
    """Return the file as a model; unknown keys are refused where the models refuse them.

    Raises:
        SiteError: with everything that is wrong.
    """
    # As JSON, because only there strict types and TOML agree: arrays make tuples, strings make
    # paths, and neither "5" nor true is a number. A date becomes a string and is refused as one.
    text = json.dumps(source.data, default=str)
    try:
        return root.model_validate_json(text, strict=True)
    except ValidationError as error:
        details = error.errors()
        raise SiteError(
            _problem(source, root, detail)
            for detail in details
            # What follows from another mistake is not one of its own: a default that depends on a
            # wrong key, a list whose only entry is wrong.
            if detail["type"] != "default_factory_not_called"
            and not (detail["type"] == "too_short" and _has_inner(details, detail["loc"]))
        ) from error


def _has_inner(details: Sequence[ErrorDetails], place: tuple[str | int, ...]) -> bool:
    return any(
        len(detail["loc"]) > len(place) and detail["loc"][: len(place)] == place
        for detail in details
    )


def _problem(source: TomlSource, root: type[BaseModel], detail: ErrorDetails) -> Problem:
    kind, value = detail["type"], detail["input"]
    key, model, field = _find_field(root, detail["loc"])
    if kind == "extra_forbidden":
        return source.problem(key, "unknown key", nearest(str(key[-1]), model.model_fields))
    if kind == "missing":
        return source.problem(key, "is missing", f"add it{_meaning(field)}")
    if kind == "too_short":
        return source.problem(key, "is empty", f"give at least one{_meaning(field)}")
    if kind == "value_error":
        message, _, remedy = detail["msg"].removeprefix("Value error, ").partition("; ")
        return source.problem(key, message, remedy)
    if kind == "literal_error" and field is not None:
        unknown = f"{_as_toml(value)} is unknown"
        return source.problem(key, unknown, nearest(str(value), _choices(field)))
    if kind in ("union_tag_invalid", "union_tag_not_found") and field is not None:
        return _wrong_kind(source, key, field, detail)
    shown = _as_toml(value)
    if kind in ("tuple_type", "list_type"):
        remedy = _how_as_array(key, None if field is None else field.annotation, value)
        return source.problem(key, f"{shown} is no array", f"{remedy}{_meaning(field)}")
    message = f"{shown}: {detail['msg'].replace('Input should', 'should')}"
    message = message.replace("be an object", "be a table")
    return source.problem(key, message, f"correct it{_meaning(field)}")


def _as_toml(value: object) -> str:
    """Return a value as a message shows it, in the words of the file."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "an array"
    return str(value).lower() if isinstance(value, bool) else quoted(value)


def _wrong_kind(
    source: TomlSource, key: tuple[str | int, ...], field: FieldInfo, detail: ErrorDetails
) -> Problem:
    """A table of several kinds whose ``kind`` is missing or unknown."""
    kinds = [
        choice for model in _models_of(field) for choice in _choices(model.model_fields["kind"])
    ]
    given = detail["input"].get("kind") if isinstance(detail["input"], dict) else None
    message = "is missing" if given is None else f"{given!r} is unknown"
    return source.problem((*key, "kind"), message, nearest(str(given or ""), kinds))


def _find_field(
    root: type[BaseModel], location: tuple[str | int, ...]
) -> tuple[tuple[str | int, ...], type[BaseModel], FieldInfo | None]:
    """Return the key as the file has it, its table's model, and its field (None when unknown).

    Pydantic's location names the kind that was chosen for a table of several kinds; the file's key
    does not.
    """
    key: list[str | int] = []
    table = root
    inner: list[type[BaseModel]] = [root]
    field: FieldInfo | None = None
    name_comes = False
    for part in location:
        chosen = [] if len(inner) < 2 else [m for m in inner if part in _kinds(m)]
        if chosen:
            inner = chosen
            table = chosen[0]
            continue
        key.append(part)
        if name_comes or isinstance(part, int):
            name_comes = False
            continue
        if not inner:
            break
        table = inner[0]
        field = table.model_fields.get(str(part))
        if field is None:
            break
        inner = list(_models_of(field))
        name_comes = get_origin(field.annotation) is Mapping
    return tuple(key), table, field


def _models_of(field: FieldInfo) -> Iterator[type[BaseModel]]:
    yield from _models_in(field.annotation)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        return
    parts = get_args(annotation)
    for part in parts[:1] if get_origin(annotation) is Annotated else parts:
        yield from _models_in(part)


def _how_as_array(key: tuple[str | int, ...], annotation: Any, value: object) -> str:
    """How to write ``value`` where an array is asked for."""
    items = _items_of(annotation)
    if isinstance(key[-1], int):
        return "put an array of its own for each, such as [[0, 99]]"
    if any(get_origin(item) is tuple for item in items):
        return f"write an array of arrays, such as [[0, {quoted(value)}]]"
    if not isinstance(value, int | float) and str not in items:
        return "write an array of numbers, such as [0, 1]"
    if len(items) > 1 and Ellipsis not in items:
        return f"write an array of {len(items)}, such as [0, {quoted(value)}]"
    return f"write [{quoted(value)}]"


def _items_of(annotation: Any) -> tuple[Any, ...]:
    """The kinds of items of an array, whatever restricts or replaces it; () for other values."""
    if get_origin(annotation) is tuple:
        return get_args(annotation)
    return next(filter(None, map(_items_of, get_args(annotation))), ())


def _kinds(model: type[BaseModel]) -> list[str]:
    field = model.model_fields.get("kind")
    return [] if field is None else _choices(field)


def _choices(field: FieldInfo) -> list[str]:
    options = [field.annotation, *get_args(field.annotation)]
    literals = [option for option in options if get_origin(option) is Literal]
    return [name for literal in literals for name in get_args(literal)]


def _meaning(field: FieldInfo | None) -> str:
    """Return what the key means, in brackets."""
    if field is None or field.description is None:
        return ""
    return f" ({field.description.rstrip('.')})"
