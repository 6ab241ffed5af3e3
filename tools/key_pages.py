"""The pages of the keys of a site file and of a scenario file, from their models."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from fieldlink.lab.rehearse.expected import END
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.site.models import SiteFile
from tools.tables import markdown_table

__all__ = ["scenario_keys_page", "site_keys_page"]

_SITE_HEAD = """# Keys of the site file

[The site file](../site-file.md) explains what it is, with examples. A key that is not listed here
is an error. Times are plant seconds, paths are relative to the site file. `fieldlink schema` prints
the same as a JSON Schema.
"""

_SCENARIO_HEAD = """# Keys of a scenario file

[Rehearsals](../rehearse.md) explains what a scenario is, with an example. A key that is not listed
here is an error. Times are plant seconds.
"""

_COLUMNS = ("key", "default", "meaning")


def site_keys_page() -> str:
    """Return the page of the site file in Markdown."""
    tables = [_section(model) for model in _models_below(SiteFile) if model is not SiteFile]
    return "\n".join([_SITE_HEAD, *tables])


def scenario_keys_page() -> str:
    """Return the page of the scenario file in Markdown."""
    return "\n".join([_SCENARIO_HEAD, *(_section(model) for model in _models_below(Scenario))])


def _models_below(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Give a model and those of its fields, each once, in the order of the file."""
    seen: list[type[BaseModel]] = []

    def visit(found: type[BaseModel]) -> None:
        if found in seen:
            return
        seen.append(found)
        for field in found.model_fields.values():
            for inner in _models_in(field.annotation):
                visit(inner)

    visit(model)
    yield from seen


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _section(model: type[BaseModel]) -> str:
    heading, _, sentence = " ".join(str(model.__doc__).split()).partition(": ")
    heading, sentence = heading.replace("``", "`"), sentence.replace("``", "`")
    if heading.startswith("kind = "):
        heading = f"`[[expect]]` with {heading}"
    fields = sorted(model.model_fields.items(), key=lambda item: item[0] != "kind")
    rows = [
        (f"`{key}`", _default_of(field), _meaning_of(field))
        for key, field in fields
        if len(get_args(field.annotation)) != 1 or get_origin(field.annotation) is not Literal
    ]
    table = markdown_table(_COLUMNS, rows)
    return f"## {heading}\n\n{sentence[0].upper()}{sentence[1:]}\n\n{table}"


def _default_of(field: Any) -> str:
    value = field.default
    if field.default_factory is not None:
        value = field.get_default(call_default_factory=True, validated_data={})
    if value is PydanticUndefined:
        return "needed"
    if value is None or isinstance(value, BaseModel):
        return ""
    if value == END:
        return "the end"
    return f"`{json.dumps(str(value) if isinstance(value, Path) else value)}`"


def _meaning_of(field: Any) -> str:
    meaning = " ".join(str(field.description or "").split()).replace("``", "`")
    choices = [choice for choice in _choices_in(field.annotation) if isinstance(choice, str)]
    if not choices:
        return meaning
    return f"{meaning} One of {', '.join(f'`{choice}`' for choice in choices)}."


def _choices_in(annotation: Any) -> Iterator[Any]:
    """Give the values of the Literals in an annotation."""
    if get_origin(annotation) is Literal:
        yield from get_args(annotation)
        return
    for argument in get_args(annotation):
        yield from _choices_in(argument)
