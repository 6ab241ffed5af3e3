"""``fieldlink init``: from a register map to a checked site file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fieldlink.cli import read_write
from fieldlink.cli.first_run import next_step, read_once, run_trial, say

if TYPE_CHECKING:
    from fieldlink.registers import Tag
    from fieldlink.site import Problem
    from fieldlink.site.loop_proposal import LoopProposal, Proposal

__all__ = ["init"]

Roles = Mapping[str, str]


def init(
    file: Annotated[
        Path, typer.Argument(help="A list of registers: .csv or .xlsx.", metavar="MAP")
    ],
    out: Annotated[Path, typer.Option(help="The new site file; its map is written beside it.")] = (
        Path("site.toml")
    ),
    host: Annotated[str | None, typer.Option(help="Host name or address of the PLC.")] = None,
    port: Annotated[int, typer.Option(min=1, max=0xFFFF, help="TCP port of the PLC.")] = 502,
    unit: Annotated[int, typer.Option(min=0, max=255, help="Modbus unit id.")] = 1,
    loop: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=OP,PV[,sp=TAG][,mode=TAG][,scan=TAG]",
            help="Tags of a loop, instead of those proposed.",
        ),
    ] = None,
    leave_out: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A loop to leave out.")
    ] = None,
    auto_values: Annotated[
        str | None,
        typer.Option(metavar="N[,N]", help="Values of the mode tags that mean automatic."),
    ] = None,
    period: Annotated[
        float, typer.Option(min=0.001, max=1e8, help="Seconds between samples of every loop.")
    ] = 1.0,
    addresses: Annotated[
        Literal["zero", "one", "modicon", "hex"] | None,
        typer.Option(help="How addresses are written; recognised unless given."),
    ] = None,
    word_order: Annotated[
        Literal["big", "little"],
        typer.Option(help="Which register of a float is first, where the list does not say."),
    ] = "big",
    sheet: Annotated[
        str | None, typer.Option(help="Sheet of a workbook; the first unless given.")
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=HEADING", help="The list's heading of a register map's column."
        ),
    ] = None,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Go on with the good rows although others are bad.")
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV",
            help="Recording whose columns are tags of the list: helps to tell OP from PV.",
        ),
    ] = None,
    trial: Annotated[
        bool, typer.Option("--trial", help="Run the new site for a minute; nothing is written.")
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="Take every clear proposal without a question.")
    ] = False,
) -> None:
    """Make a site file from a register map: propose loops from the tags' names, ask, check.

    Nothing is written to the PLC, and write-back is off in the new file. With --host every tag is
    read once, with --trial for a minute.
    """
    from fieldlink.cli.map_commands import parse_headings
    from fieldlink.cli.role_questions import RecordedTags, doubt_loop, propose_roles
    from fieldlink.cli.site import check
    from fieldlink.site import SiteError
    from fieldlink.site.loop_proposal import propose_loops
    from fieldlink.site.map_import import import_map
    from fieldlink.site.site_draft import PLACEHOLDER, SiteDraft, map_path_of, refuse_existing

    if host is not None:
        _check_host(host)
    elif trial and not read_write.is_terminal():
        raise typer.BadParameter("a trial needs a PLC: give --host", param_hint="--trial")
    refuse_existing(out, map_path_of(out))
    found = import_map(
        file,
        addresses=addresses,
        sheet=sheet,
        headings=parse_headings(column or []),
        word_order=word_order,
    )
    for note in found.notes:
        say(f"  {note}")
    for problem in found.problems:
        say(f"bad row {problem}")
    if found.problems and not skip_bad:
        say("nothing is written; correct the rows, or leave them out with --skip-bad")
        raise typer.Exit(2)
    given = _given_loops(loop or [], found.tags)
    proposal = propose_loops(found.tags.values())
    may_ask = read_write.is_terminal()
    clear, unclear = _divide(proposal, given, leave_out or [])
    recorded = None if data is None else RecordedTags(data)
    if recorded is not None:
        doubts = {n: doubt_loop(n, roles, recorded, say) for n, roles in clear.items()}
        unclear += [doubt for doubt in doubts.values() if doubt is not None]
        clear = {name: roles for name, roles in clear.items() if doubts[name] is None}
    proposed = {
        each.name: {} if recorded is None else propose_roles(each, recorded, say)
        for each in unclear
    }
    if unclear and not may_ask:
        raise SiteError(_unclear_problems(file, unclear, proposed))
    loops: dict[str, Roles] = {**given, **clear}
    for each in unclear:
        if (answered := _ask_roles(each, proposed[each.name])) is not None:
            loops[each.name] = answered
    if not loops:
        raise typer.BadParameter(
            f"{file}: no tags that are OP and PV of one loop; name them with "
            "--loop NAME=OPTAG,PVTAG",
            param_hint="MAP",
        )
    for name, roles in sorted(loops.items()):
        say(f"  loop {name}: " + ", ".join(f"{role} {tag}" for role, tag in roles.items()))
    taken = {tag for roles in loops.values() for tag in roles.values()}
    for half in proposal.halves:
        if not half.all_tags & taken:
            lacks = "PV" if "op" in (*half.roles, *half.unclear) else "OP"
            say(f"  left out: {half.name} has no {lacks} ({', '.join(sorted(half.all_tags))})")
    values = _automatic(auto_values, loops, may_ask)
    if host is None and may_ask and not yes:
        host = (
            typer.prompt("host of the PLC (empty: later)", default="", show_default=False) or None
        )
    draft = SiteDraft(
        out, dict(sorted(loops.items())), host or PLACEHOLDER, port, unit, period, values, file.name
    )
    say(f"  every {period:g} s (--period); write-back off")
    if not yes:
        if not may_ask:
            raise typer.BadParameter(
                "not given, and there is no terminal to ask on; add it", param_hint="--yes"
            )
        typer.confirm(f"write {out} and {map_path_of(out)}?", abort=True)
    draft.write(found.tags)
    say(f"written: {out}, and {map_path_of(out)} with {len(taken)} of {len(found.tags)} tags")
    check(out)
    answers = host is not None and read_once(out)
    tried = run_trial(out) if trial and answers else None
    typer.echo(f"next: {next_step(out, host, answers, tried)}")


def _check_host(host: str) -> None:
    name, colon, port = host.rpartition(":")
    if not host.strip():
        raise typer.BadParameter("give a host name or an address", param_hint="--host")
    if colon and ":" not in name:
        raise typer.BadParameter(
            f"{host!r} holds a port; give --host {name} --port {port or 502}", param_hint="--host"
        )


def _given_loops(texts: list[str], tags: Mapping[str, Tag]) -> dict[str, Roles]:
    """Return loop to role to tag of ``FC101=OPTAG,PVTAG,sp=SPTAG``."""
    from fieldlink.site.errors import nearest
    from fieldlink.site.loop_proposal import ROLES

    given: dict[str, Roles] = {}
    for text in texts:
        name, _, rest = (part.strip() for part in text.partition("="))
        op, _, others = rest.partition(",")
        pv, *more = others.split(",")
        roles = {"op": op.strip(), "pv": pv.strip()}
        for part in more:
            role, _, tag = part.partition("=")
            roles[role.strip()] = tag.strip()
        if not name or not all(roles.values()) or not set(roles) <= set(ROLES) or name in given:
            raise typer.BadParameter(
                f"{text!r} is not NAME=OP,PV with a new name, such as FC101=FC101.OUT,FC101.PV or "
                "FC101=FC101.OUT,FC101.PV,sp=FC101.SP",
                param_hint="--loop",
            )
        for tag in roles.values():
            if tag not in tags:
                raise typer.BadParameter(
                    f"{tag!r} is not a tag of the list; {nearest(tag, tags)}", param_hint="--loop"
                )
        given[name] = roles
    return given


def _divide(
    proposal: Proposal, given: Mapping[str, Roles], leave_out: list[str]
) -> tuple[dict[str, Roles], list[LoopProposal]]:
    """Return the loops that are clear, and those with a question, less what is settled."""
    from fieldlink.site.errors import nearest

    names = [loop.name for loop in proposal.loops]
    if unknown := [name for name in leave_out if name not in names]:
        raise typer.BadParameter(
            f"no loop {unknown[0]!r} is proposed; {nearest(unknown[0], names)}",
            param_hint="--leave-out",
        )
    settled = {tag for roles in given.values() for tag in (roles["op"], roles["pv"])}
    open_loops = [
        loop
        for loop in proposal.loops
        if loop.name not in given and loop.name not in leave_out and not loop.all_tags & settled
    ]
    clear = {loop.name: loop.roles for loop in open_loops if not loop.unclear}
    return clear, [loop for loop in open_loops if loop.unclear]


def _unclear_problems(
    file: Path, unclear: list[LoopProposal], proposed: Mapping[str, Roles]
) -> list[Problem]:
    from fieldlink.site import Problem

    problems = []
    for loop in unclear:
        choices = "; ".join(
            f"{role.upper()} may be {' or '.join(tags)}" for role, tags in loop.unclear.items()
        )
        first = {role: tags[0] for role, tags in loop.unclear.items()}
        example = {**first, **loop.roles, **proposed[loop.name]}
        message = f"{choices}, and there is no terminal to ask on"
        remedy = (
            f"name the tags, such as --loop {loop.name}={example['op']},{example['pv']}, or leave "
            f"the loop out with --leave-out {loop.name}"
        )
        problems.append(Problem(str(file), loop.name, message, remedy))
    return problems


def _ask_roles(loop: LoopProposal, proposed: Roles) -> Roles | None:
    """Ask for the unclear roles; None when the loop is to be left out.

    What the data propose is the answer of an empty line, and shown as that.
    """
    roles = dict(loop.roles)
    for role, tags in loop.unclear.items():
        optional = role not in ("op", "pv")
        empty = f"no {role.upper()}" if optional else "leave the loop out"
        while True:
            offered = proposed.get(role, "")
            question = (
                f"{loop.name}: which tag is {role.upper()}: {', '.join(tags)}? "
                + (f"(empty: {offered}, as the data say; -: " if offered else "(empty: ")
                + f"{empty})"
            )
            answer = typer.prompt(
                question, default=offered, show_default=False, prompt_suffix=" "
            ).strip()
            if offered and answer == "-":
                answer = ""
            if answer in tags:
                roles[role] = answer
            elif answer:
                say(f"{answer} is none of them")
                continue
            elif not optional:
                return None
            break
    return roles


def _automatic(text: str | None, loops: Mapping[str, Roles], may_ask: bool) -> tuple[float, ...]:
    """Return the values of the mode tags that mean automatic; they are never assumed."""
    modes = [roles["mode"] for roles in loops.values() if "mode" in roles]
    if not modes:
        return (1.0,)
    if text is None:
        if not may_ask:
            raise typer.BadParameter(
                f"the list does not say which values of {', '.join(modes)} mean automatic; "
                "give them, such as --auto-values 1",
                param_hint="--auto-values",
            )
        text = typer.prompt(f"values of {', '.join(modes)} that mean automatic, such as 1 or 1,2")
    try:
        values = tuple(float(part) for part in text.split(","))
        if not all(map(math.isfinite, values)):
            raise ValueError(text)
    except ValueError as error:
        raise typer.BadParameter(
            f"{text!r} is not a list of numbers, such as 1 or 1,2", param_hint="--auto-values"
        ) from error
    return values
