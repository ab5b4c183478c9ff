"""A set in all formats that were asked for; what the data is not enough for is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from percept.cli.progress import progress_bar
from percept.core.errors import InputError
from percept.datasets.labelling.formats import ExportFormat, export
from percept.datasets.labelling.labelled_set import LabelledSet

__all__ = ["WrittenFormats", "write_formats"]


@dataclass(slots=True)
class WrittenFormats:
    """What exporters said.

    Attributes:
        losses: By format that was written, what it cannot hold.
        refused: By format that was not, why.
    """

    losses: dict[str, tuple[str, ...]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


def write_formats(
    labelled: LabelledSet, formats: Sequence[ExportFormat], check_interrupt: Callable[[], None]
) -> WrittenFormats:
    """Write all formats below the folder of a set; one that is refused does not stop the others.

    Args:
        labelled: The set.
        formats: Their names.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.

    Raises:
        InputError: If all are refused; the folder of the set is gone then.
    """
    written = WrittenFormats()
    with progress_bar("writing formats", len(formats)) as advance:
        for number, name in enumerate(formats):
            target = labelled.folder / name
            if target.exists():  # of a preparation that was interrupted here
                shutil.rmtree(target)
            try:
                written.losses[name] = export(labelled, name, target)
            except InputError as error:
                shutil.rmtree(target, ignore_errors=True)
                written.refused[name] = " ".join(str(error).split())
            advance(number + 1)
            check_interrupt()
    if not written.losses:
        shutil.rmtree(labelled.folder)
        reasons = "; ".join(f"{name}: {why}" for name, why in written.refused.items())
        raise InputError(f"none of the formats can be written ({reasons})")
    return written
