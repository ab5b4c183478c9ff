"""Showing a view in rerun's own window, on this computer alone."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from percept.core.errors import DependencyError, InputError

__all__ = ["open_view"]

# `python -m rerun_cli` loses the exit code of the program.
_RUN_RERUN = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"


def open_view(path: Path) -> None:
    """Show a view in rerun's own window, and return when it is closed.

    The viewer listens on the loopback interface only.

    Args:
        path: The `.rrd` file.

    Raises:
        InputError: If there is no such file.
        DependencyError: If there is no screen, or the viewer is missing or fails.
    """
    if not path.is_file():
        raise InputError("there is no such view", where=path, remedy="Give a finished run")
    if find_spec("rerun_cli") is None:
        raise DependencyError(
            "the rerun viewer is not installed", remedy="pip install 'rerun-sdk>=0.41,<0.42'"
        )
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        raise DependencyError(
            "there is no screen to show it on",
            where=path,
            remedy=f"Copy the file to a computer with a screen and run `rerun {path.name}` there",
        )
    command = [sys.executable, "-c", _RUN_RERUN, str(path), "--bind", "127.0.0.1", "--new"]
    code = subprocess.run(command, check=False).returncode  # noqa: S603 - no shell, fixed program
    if code != 0:
        raise DependencyError(
            f"the rerun viewer ended with code {code}",
            where=path,
            remedy="It needs OpenGL or Vulkan; try the file on another computer",
        )
