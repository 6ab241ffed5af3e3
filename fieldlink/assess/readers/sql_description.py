"""A historian's SQL table in a few lines of TOML.

A row a moment (``op`` and ``pv`` are columns)::

    [sql]
    url = "postgresql://reader@historian/plant"
    table = "loop_history"
    loop = "loop_name"
    time = "ts"
    op = "out_pct"
    pv = "value"

or a row a value (``tag`` and ``value`` are columns)::

    [sql]
    url = "postgresql://reader@historian/plant"
    table = "history"
    time = "ts"
    tag = "tagname"
    value = "val"
    tags = { op = "{loop}.OP", pv = "{loop}.PV", sp = "{loop}.SP" }
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from fieldlink.assess.errors import AssessError
from fieldlink.file_at import why_no_file
from fieldlink.site.errors import SiteError
from fieldlink.site.toml_source import TomlSource
from fieldlink.site.validation import validated
from fieldlink.sqlite_url import SQLITE, sqlite_url
from fieldlink.store import StoreError
from fieldlink.store.database import file_of

__all__ = ["SqlTable", "TagNames", "read_description"]

LOOP = "{loop}"
"""Stands for the loop's name in the name of a tag."""


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class TagNames(_Model):
    """How the tags of a loop are named; ``{loop}`` stands for the loop's name."""

    op: str = Field(description="tag of the controller output")
    pv: str = Field(description="tag of the process variable")
    sp: str | None = Field(default=None, description="tag of the set-point")
    auto: str | None = Field(default=None, description="tag that is not 0 in automatic")

    @model_validator(mode="after")
    def _name_the_loop(self) -> Self:
        for role, name in self.named().items():
            if name.count(LOOP) != 1:
                raise ValueError(
                    f"{role} is {name!r} without {LOOP}; write {LOOP} once, where tags have the "
                    "loop's name"
                )
        return self

    def named(self) -> dict[str, str]:
        """The names that are given, by role."""
        roles = {"op": self.op, "pv": self.pv, "sp": self.sp, "auto": self.auto}
        return {role: name for role, name in roles.items() if name is not None}


class SqlTable(_Model):
    """One table of a historian."""

    url: str = Field(description="database address, such as postgresql://reader@host/database")
    password_file: str | None = Field(
        default=None, description="file whose first line is the password"
    )
    table: str = Field(description="table or view, with its schema where it has one: plant.history")
    time: str = Field(description="column of the time stamps")
    time_unit: Literal["s", "ms", "us", "ns"] = Field(
        default="s", description="unit of times that are numbers since 1970"
    )
    period: float | None = Field(default=None, gt=0.0, description="seconds between samples")
    loop: str | None = Field(default=None, description="column of the loop's name")
    op: str = Field(default="op", description="column of the controller output")
    pv: str = Field(default="pv", description="column of the process variable")
    sp: str | None = Field(default=None, description="column of the set-point")
    auto: str | None = Field(default=None, description="column that is not 0 in automatic")
    tag: str | None = Field(default=None, description="column of the tag's name")
    value: str | None = Field(default=None, description="column of the value")
    tags: TagNames | None = Field(default=None, description="names of a loop's tags")
    quality: str | None = Field(default=None, description="column of the quality")
    good: tuple[int | str, ...] = Field(default=(), description="qualities that are good")
    name: str = Field(default="", description="name of the loop, where the table has one only")

    @property
    def counts_a_second(self) -> float:
        """How many of what numbers count a second has."""
        return {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[self.time_unit]

    def columns(self) -> dict[str, str]:
        """The columns that the table must have, by their key here."""
        keys = ["time", "quality"]
        keys += ["loop", "op", "pv", "sp", "auto"] if self.tags is None else ["tag", "value"]
        return {key: name for key in keys if (name := getattr(self, key)) is not None}

    @model_validator(mode="after")
    def _one_layout(self) -> Self:
        given = [self.tag is not None, self.value is not None, self.tags is not None]
        if any(given) and not all(given):
            raise ValueError("tag, value and tags go together; give all three or none of them")
        if (self.quality is None) != (not self.good):
            raise ValueError("quality and good go together; give both or none of them")
        return self


class _File(_Model):
    sql: SqlTable = Field(description="the table")


def read_description(path: Path) -> SqlTable:
    """Read a description; relative paths in it are beside it.

    Raises:
        SiteError: it is not such a description; every mistake with its line.
        AssessError: its password file cannot be read.
    """
    source = TomlSource(path)
    table = validated(source, _File).sql
    url = table.url
    if url.startswith(SQLITE) and not Path(url.removeprefix(SQLITE)).is_absolute():
        url = f"{sqlite_url(path.parent.absolute())}/{url.removeprefix(SQLITE)}"
    try:
        file = file_of(url)
    except StoreError as error:
        # Not the text itself: a password may be in it.
        remedy = "write sqlite:///plant.sqlite or postgresql://USER@HOST:5432/DATABASE"
        problem = source.problem(("sql", "url"), "is not a database address", remedy)
        raise SiteError([problem]) from error
    if file is not None and (why := why_no_file(file)):
        said = f"there is no file {file} ({why})"
        raise SiteError([source.problem(("sql", "url"), said, "check the path")])
    if table.password_file is not None:
        url = _with_password(url, path.parent / table.password_file)
    return table.model_copy(
        update={"url": url, "name": table.name or path.stem, "password_file": None}
    )


def _with_password(url: str, file: Path) -> str:
    from sqlalchemy.engine import make_url

    try:
        password = file.read_text(encoding="utf-8").partition("\n")[0].strip()
    except (OSError, UnicodeDecodeError) as error:
        raise AssessError(
            f"the password file {file} cannot be read ({error}); check sql.password_file"
        ) from error
    return make_url(url).set(password=password).render_as_string(hide_password=False)
