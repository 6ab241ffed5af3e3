"""The command line in this process: what the script ``fieldlink`` calls, without a new process."""

from __future__ import annotations

import contextlib
import io
import subprocess
from pathlib import Path
from unittest import mock

from fieldlink.cli.app import main

__all__ = ["run_typed"]


def run_typed(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run ``fieldlink ARGUMENTS`` in a folder; a defect comes as its exception."""
    typed = ["fieldlink", *map(str, arguments)]
    out, err, status = io.StringIO(), io.StringIO(), 0
    with (
        mock.patch("sys.argv", typed),
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    return subprocess.CompletedProcess(typed, status, out.getvalue(), err.getvalue())
