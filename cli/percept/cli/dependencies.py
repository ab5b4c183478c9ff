"""What to say when a part that is needed is not installed."""

from __future__ import annotations

import re

from percept.core.errors import DependencyError

__all__ = ["explain_import_error"]

_DEBIAN_PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libglib-2.0.so.0": "libglib2.0-0",
    "libgomp.so.1": "libgomp1",
    "libgthread-2.0.so.0": "libglib2.0-0",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
_MISSING_LIBRARY = re.compile(r"(lib[\w.+-]+\.so[.\d]*): cannot open shared object file")


def explain_import_error(error: ImportError) -> DependencyError | None:
    """Return the error to show for a missing package or system library.

    Args:
        error: What the import raised.

    Returns:
        The explanation with the command that installs the part, or None where the
        import failed for another reason, which is then a bug.
    """
    missing = _MISSING_LIBRARY.search(str(error))
    if missing:
        library = missing.group(1)
        package = _DEBIAN_PACKAGES.get(library)
        remedy = (
            f"Install it: sudo apt-get install {package}"
            if package
            else f"Find it: apt-file search {library}"
        )
        return DependencyError(f"the system library {library} is missing", remedy=remedy)
    if isinstance(error, ModuleNotFoundError) and error.name:
        root = error.name.partition(".")[0]
        if root != "percept":
            return DependencyError(
                f"the Python package '{root}' is missing",
                remedy="Install it: pip install --upgrade percept-toolkit",
            )
    return None
