"""What a command does about errors: exit code 2 for the user's, 1 for ours, one clear line."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import NoReturn

import typer

from depthwarp.cli.report import Reporter
from depthwarp.errors import DepthwarpError

__all__ = ["run_command"]

BAD_INPUT, OUR_FAILURE, INTERRUPTED = 2, 1, 130


def run_command(reporter: Reporter, command: Callable[[], None]) -> None:
    """Run a command's body; on an error say what happened and exit with its code.

    Raises:
        typer.Exit: With 2 for bad input, 130 for Ctrl-C, 1 for anything else.
    """
    try:
        command()
    except (DepthwarpError, OSError) as error:
        _fail(reporter, str(error), BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):  # at a prompt, Ctrl-C and the end of input are Abort
        _fail(reporter, "interrupted", INTERRUPTED)
    except typer.Exit:
        raise
    except Exception as error:
        reporter.say(traceback.format_exc())
        _fail(
            reporter,
            f"depthwarp failed ({type(error).__name__}: {error}): this is a defect of depthwarp, "
            "please report it with the lines above",
            OUR_FAILURE,
        )


def _fail(reporter: Reporter, message: str, code: int) -> NoReturn:
    reporter.error(message)
    raise typer.Exit(code)
