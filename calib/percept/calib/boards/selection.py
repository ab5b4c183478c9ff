"""Which views of a board are worth using: of one size, sharp, undisturbed, each seen once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from percept.calib.boards.views import BoardView, NoBoard

__all__ = ["select_views"]

_MOST_RISE = 2.5  # times the median view's; views of one camera differ by less than two
_SHARP_PX = 4.0  # edges that rise faster are sharp enough, however sharp the others are
_WILD_PX = 2.0  # ten times what noise does to a corner
_MOST_WILD = 1  # a lone corner is set right by its neighbours; of two the neighbours are in doubt
_SAME = 0.01  # of the board's size in the image; a hand that holds a board still moves as much
_FEWEST_COMMON = 0.8  # of the corners, for two views to be compared


def select_views(views: Sequence[BoardView]) -> tuple[list[BoardView], list[NoBoard]]:
    """Sort out views of another size, blurred and disturbed ones, and those that repeat another.

    Args:
        views: Of one camera, in the order of their capture.

    Returns:
        The views to use, in their order, and the others with reasons.
    """
    kept, rejected = _of_one_size(views)
    kept, blurred = _sharp(kept)
    kept, disturbed = _undisturbed(kept)
    kept, repeated = _distinct(kept)
    return kept, rejected + blurred + disturbed + repeated


def _of_one_size(views: Sequence[BoardView]) -> tuple[list[BoardView], list[NoBoard]]:
    if not views:
        return [], []
    sizes = Counter(view.image_size for view in views)
    usual = max(sizes, key=lambda size: (sizes[size], size))
    text = f"{usual[0]}x{usual[1]}"
    other = [
        NoBoard(v.name, f"the image is {v.image_size[0]}x{v.image_size[1]}, most are {text}")
        for v in views
        if v.image_size != usual
    ]
    return [view for view in views if view.image_size == usual], other


def _sharp(views: Sequence[BoardView]) -> tuple[list[BoardView], list[NoBoard]]:
    rises = [view.blur_px for view in views if np.isfinite(view.blur_px)]
    limit = max(_SHARP_PX, _MOST_RISE * float(np.median(rises))) if rises else np.inf
    blurred = [
        NoBoard(v.name, f"blurred: its edges rise over {v.blur_px:.1f} px, more than {limit:.1f}")
        for v in views
        if v.blur_px > limit
    ]
    return [view for view in views if not view.blur_px > limit], blurred


def _undisturbed(views: Sequence[BoardView]) -> tuple[list[BoardView], list[NoBoard]]:
    """Leave out views where something beside the board moved several corners.

    Where most views are like that, the board itself is (its margin is narrow), and they stay: the
    narrow windows were used for those corners.
    """
    wild = [int((view.jumps_px > _WILD_PX).sum()) for view in views]
    out = [count > _MOST_WILD for count in wild]
    if 2 * sum(out) > len(views):
        return list(views), []
    disturbed = [
        NoBoard(
            view.name,
            f"outlier: {count} corners jump by up to {view.jumps_px.max():.1f} px with the size of "
            "the sub-pixel window; something lies too near to them, or the margin is too narrow",
        )
        for view, count, bad in zip(views, wild, out, strict=True)
        if bad
    ]
    return [view for view, bad in zip(views, out, strict=True) if not bad], disturbed


def _distinct(views: Sequence[BoardView]) -> tuple[list[BoardView], list[NoBoard]]:
    """Keep the sharper one of views that show the board at the same place."""
    kept: list[BoardView] = []
    repeated: list[NoBoard] = []
    ranked = sorted(views, key=lambda v: v.blur_px if np.isfinite(v.blur_px) else np.inf)
    for view in ranked:
        same = next((other for other in kept if _is_same(view, other)), None)
        if same is None:
            kept.append(view)
        else:
            repeated.append(NoBoard(view.name, f"shows the board at the same place as {same.name}"))
    place = {id(view): index for index, view in enumerate(views)}
    return sorted(kept, key=lambda v: place[id(v)]), repeated


def _is_same(view: BoardView, other: BoardView) -> bool:
    common, here, there = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(common) < _FEWEST_COMMON * max(len(view.ids), len(other.ids)):
        return False
    shift = np.linalg.norm(view.corners_px[here] - other.corners_px[there], axis=1)
    size = float(np.hypot(*np.ptp(view.corners_px, axis=0)))
    return bool(shift.mean() < _SAME * size)
