"""One image in the folders of several formats, without its bytes being there several times."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

__all__ = ["place_file"]

_CANNOT_LINK = {errno.EXDEV, errno.EPERM, errno.EMLINK, errno.ENOTSUP, errno.ENOSYS, errno.EACCES}


def place_file(source: Path, target: Path) -> None:
    """Make a file appear under a second name: a hard link, or a copy where there are no links.

    Args:
        source: The file.
        target: Its second name; the folders above are made.

    Raises:
        OSError: If the target exists or cannot be written.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError as error:
        if error.errno not in _CANNOT_LINK:
            raise
        shutil.copyfile(source, target)
