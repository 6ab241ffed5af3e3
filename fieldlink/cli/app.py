"""The console script ``fieldlink`` and what its commands share.

A command imports what it needs when it runs, so that ``fieldlink --help`` does not wait for a
numeric library. Every error that a user can cause ends as one message on stderr and exit status 2;
a traceback means a defect of ours.
"""

from __future__ import annotations

import sys

import typer

from fieldlink.cli import (
    assess,
    by_hand,
    compensate,
    demo,
    diagnose,
    fleet,
    fmu,
    history,
    identify,
    init,
    notify,
    registers_io,
    rehearse,
    report,
    scan,
    simulate,
    site,
    standing,
    support,
    web,
    work,
)
from fieldlink.cli.examples import FIRST_STEPS, PANELS, examples_of

__all__ = ["app", "main"]

app = typer.Typer(
    name="fieldlink",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Brackets in a help text are brackets, as in [web].
    rich_markup_mode="markdown",
    help="Find sticky control valves from OP and PV, and take their oscillation away.",
    epilog=FIRST_STEPS,
)
app.callback()(support.show_options)
app.command("identify")(identify.identify)
app.command("diagnose")(diagnose.diagnose)
app.command("assess")(assess.assess)
app.command("demo")(demo.demo)
app.command("init")(init.init)
app.command("check")(site.check)
app.command("schema")(site.schema)
app.command("plant")(fleet.plant)
app.command("run")(fleet.run)
app.command("rehearse")(rehearse.rehearse)
app.command("simulate")(simulate.simulate)
app.command("compensate")(compensate.compensate)
app.command("web")(web.web)
app.command("status")(standing.status)
app.command("events")(standing.events)
app.command("withdraw")(standing.withdraw)
app.command("report")(report.report)
app.command("work")(work.work)
app.command("backup")(history.backup)
app.command("export")(history.export)
app.command("support-bundle")(support.support_bundle)
app.command("scan")(scan.scan)
app.command("read")(by_hand.read)
app.command("write")(by_hand.write)
app.add_typer(registers_io.app, name="map")
app.add_typer(fmu.app, name="fmu")
app.add_typer(notify.app, name="notify")
app.command("warm-up")(identify.warm_up)


def _add_examples(commands: typer.Typer, group: str = "") -> None:
    """Give every command its examples, and its section of the list."""
    panels = {name: panel for panel, names in PANELS.items() for name in names}
    for info in commands.registered_commands:
        assert info.name is not None
        info.epilog = examples_of(f"{group}{info.name}")
        if not group and info.name in panels:
            info.rich_help_panel = panels[info.name]
    for inner in commands.registered_groups:
        assert inner.typer_instance is not None
        assert isinstance(inner.name, str)
        if inner.name in panels:
            inner.rich_help_panel = panels[inner.name]
        _add_examples(inner.typer_instance, f"{inner.name} ")


_add_examples(app)


def main() -> None:
    """Run the command line and exit."""
    try:
        app()
    except BrokenPipeError:
        # The reader of a pipe (head, less) closed it: not an error of ours.
        sys.stderr.close()
    except Exception as error:
        from fieldlink.cli.errors import explain

        if not explain(error):
            raise
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
