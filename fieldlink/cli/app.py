"""The console script ``fieldlink`` and what its commands share.

A command imports what it needs when it runs, so that ``fieldlink --help`` does not wait for a
numeric library. Every error that a user can cause ends as one message on stderr and exit status 2;
a traceback means a defect of the program.
"""

from __future__ import annotations

import sys

import typer

from fieldlink.cli import (
    ask_daemon,
    assess,
    backup_export,
    compensate,
    demo,
    diagnose,
    fmu,
    identify,
    init,
    map_commands,
    notify,
    read_write,
    rehearse,
    report,
    run,
    scan,
    service,
    simulate,
    site,
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
app.command("demo", cls=demo.DemoCommand)(demo.demo)
app.command("init")(init.init)
app.command("check")(site.check)
app.command("schema")(site.schema)
app.command("plant")(run.plant)
app.command("run")(run.run)
app.command("rehearse")(rehearse.rehearse)
app.command("simulate")(simulate.simulate)
app.command("compensate")(compensate.compensate)
app.command("web")(web.web)
app.command("status")(ask_daemon.status)
app.command("events")(ask_daemon.events)
app.command("withdraw")(ask_daemon.withdraw)
app.command("report")(report.report)
app.command("work")(work.work)
app.command("backup")(backup_export.backup)
app.command("export")(backup_export.export)
app.command("support-bundle")(support.support_bundle)
app.command("scan")(scan.scan)
app.command("read")(read_write.read)
# A negative value is no option.
app.command("write", context_settings={"ignore_unknown_options": True})(read_write.write)
app.add_typer(map_commands.app, name="map")
app.add_typer(service.app, name="service")
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
    from fieldlink.cli.full_output import flush_output, is_output_lost

    try:
        try:
            app()
        finally:
            flush_output()
    except BrokenPipeError:
        # The reader of a pipe (head, less) closed it: not an error.
        sys.stderr.close()
    except Exception as error:
        from fieldlink.cli.errors import explain

        if not is_output_lost(error) and not explain(error):
            raise
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
