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
    compensate,
    demo,
    device_tools,
    diagnose,
    fleet,
    fmu,
    history,
    identify,
    registers_io,
    rehearse,
    simulate,
    site,
    standing,
)

__all__ = ["app", "main"]

app = typer.Typer(
    name="fieldlink",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Find sticky control valves from OP and PV, and take their oscillation away.",
)
app.command("identify")(identify.identify)
app.command("diagnose")(diagnose.diagnose)
app.command("assess")(assess.assess)
app.command("demo")(demo.demo)
app.command("check")(site.check)
app.command("schema")(site.schema)
app.command("plant")(fleet.plant)
app.command("run")(fleet.run)
app.command("rehearse")(rehearse.rehearse)
app.command("simulate")(simulate.simulate)
app.command("compensate")(compensate.compensate)
app.command("status")(standing.status)
app.command("events")(standing.events)
app.command("withdraw")(standing.withdraw)
app.command("backup")(history.backup)
app.command("export")(history.export)
app.command("scan")(device_tools.scan)
app.command("read")(device_tools.read)
app.command("write")(device_tools.write)
app.add_typer(registers_io.app, name="map")
app.add_typer(fmu.app, name="fmu")
app.command("warm-up")(identify.warm_up)


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
