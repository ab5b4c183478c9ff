"""What `--anonymise` looks for, and with which networks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from percept.core.errors import UsageError
from percept.datasets.labelling.images.anonymise import Anonymiser
from percept.detection.regions import REGION_KINDS, RegionKind, RegionModel, open_region_model

__all__ = ["anonymiser_of"]


def anonymiser_of(
    kinds: Sequence[str], models: Mapping[str, str]
) -> tuple[Anonymiser | None, dict[str, RegionModel]]:
    """Return what makes persons unknown, and its networks by kind; None where nothing is asked.

    Args:
        kinds: What to make unreadable: `faces`, `plates`.
        models: By kind, the ONNX file that finds it. Faces need none where CenterFace is there.

    Raises:
        UsageError: If a kind is not known, or a file is given for what is not asked.
        PerceptError: If a network is missing or cannot be used.
    """
    strange = sorted({*kinds, *models} - set(REGION_KINDS))
    if strange:
        raise UsageError(
            f"--anonymise knows no '{', '.join(strange)}'",
            remedy=f"Choose from {', '.join(REGION_KINDS)}",
        )
    unasked = sorted(set(models) - set(kinds))
    if unasked:
        raise UsageError(
            f"--anonymise-model names {', '.join(unasked)}, which --anonymise does not",
            remedy=f"Add --anonymise {','.join([*kinds, *unasked])}",
        )
    wanted: list[RegionKind] = [kind for kind in REGION_KINDS if kind in kinds]
    if not wanted:
        return None, {}
    found: dict[str, RegionModel] = {
        kind: open_region_model(kind, Path(models[kind]) if kind in models else None)
        for kind in wanted
    }
    return Anonymiser(found), found
