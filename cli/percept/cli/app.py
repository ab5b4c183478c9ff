"""The `percept` command: its tree, and the one catcher of expected errors.

Command files import nothing heavy at their top, so that `percept --help` answers at once;
a test holds them to it.
"""

from __future__ import annotations

import errno
import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from percept.cli import calib, demo, detect, inspect, synth, view
from percept.cli.dataset.app import app as dataset_app
from percept.cli.dependencies import explain_import_error
from percept.cli.eval import app as eval_app
from percept.cli.lanes import lanes
from percept.cli.map.app import app as map_app
from percept.cli.odometry import odometry
from percept.cli.track.command import track
from percept.core.errors import PerceptError, UsageError

__all__ = ["app", "main"]

_INTERRUPTED = 130


class _PerceptGroup(TyperGroup):
    """Turns expected errors into one line on stderr and their exit code."""

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - the context type is not public
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except PerceptError as error:
            raise _ended_by(error) from error
        except ImportError as error:
            explained = explain_import_error(error)
            if explained is None:
                raise
            raise _ended_by(explained) from error
        except BrokenPipeError as error:  # `percept inspect LOG | head` is no error
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from error
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            full = UsageError("the disk is full", where=error.filename, remedy="Make room for it")
            raise _ended_by(full) from error
        except KeyboardInterrupt as error:
            typer.echo("interrupted: what was finished is kept", err=True)
            raise typer.Exit(_INTERRUPTED) from error


def _ended_by(error: PerceptError) -> typer.Exit:
    line = " ".join(str(error).split())
    typer.echo(f"error: {line}", err=True)
    return typer.Exit(error.exit_code)


app = typer.Typer(
    cls=_PerceptGroup,
    name="percept",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
app.command("demo")(demo.demo)
app.add_typer(synth.app, name="synth")
app.add_typer(calib.app, name="calib")
app.command("inspect")(inspect.inspect)
app.add_typer(detect.app, name="detect")
app.command("track")(track)
app.add_typer(eval_app, name="eval")
app.command("odometry")(odometry)
app.add_typer(map_app, name="map")
app.command("lanes")(lanes)
app.add_typer(dataset_app, name="dataset")
app.command("view")(view.view)


def _show_version(wanted: bool) -> None:  # noqa: FBT001 - Typer calls it with the flag's value
    if wanted:
        from importlib.metadata import version

        typer.echo(f"percept {version('percept-toolkit')}")
        raise typer.Exit


@app.callback()
def percept(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Perception for recorded drives, offline: one command for each job.

    Example: percept demo --out demo
    """


def main() -> None:
    """Run the command line and leave with its exit code."""
    app()
