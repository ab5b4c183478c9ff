"""The flags of `percept dataset prepare` that are more than one value."""

from __future__ import annotations

from typing import Any, get_args

from percept.core.errors import UsageError
from percept.datasets.labelling.choice.keyframes import KeyframeConfig
from percept.datasets.labelling.formats import ExportFormat

__all__ = ["formats_of", "kinds_of", "settings_of"]


def formats_of(text: str) -> tuple[ExportFormat, ...]:
    """Return the formats that `--format` names, each once, in their usual order.

    Raises:
        UsageError: If one is not known, or there is none.
    """
    known: tuple[ExportFormat, ...] = get_args(ExportFormat)
    named = {name.strip() for name in text.split(",")} - {""}
    strange = sorted(named - set(known))
    if strange or not named:
        raise UsageError(
            f"--format knows no '{', '.join(strange)}'" if strange else "--format names no format",
            remedy=f"Choose from {', '.join(known)}",
        )
    return tuple(name for name in known if name in named)


def kinds_of(text: str | None) -> tuple[str, ...]:
    """Return what `--anonymise` names, each once."""
    parts = (name.strip() for name in (text or "").split(","))
    return tuple(dict.fromkeys(name for name in parts if name))


def settings_of(
    *,
    every: float | None,
    distance: float | None,
    margin: float | None,
    cell: float | None,
    thresholds: dict[str, str],
) -> dict[str, Any]:
    """Return the settings that flags overrule, nested as in a file.

    Raises:
        UsageError: If a threshold is no number.
    """
    scores = {name: _score(name, text) for name, text in thresholds.items()}
    # Who asks for more than the usual gap allows means it.
    gap = every if every is not None and every < KeyframeConfig().min_gap_s else None
    return {
        "keyframes": {"every_s": every, "distance_m": distance, "min_gap_s": gap},
        "split": {"margin_m": margin, "cell_m": cell},
        "prelabels": {"images": {"classes": scores or None}, "solids": {"classes": scores or None}},
    }


def _score(name: str, text: str) -> float:
    try:
        score = float(text)
    except ValueError as error:
        raise UsageError(f"--threshold {name}={text} is no number") from error
    if not 0 <= score <= 1:
        raise UsageError(f"--threshold {name}={text} is not between 0 and 1")
    return score
