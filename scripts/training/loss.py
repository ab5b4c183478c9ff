"""What the network is taught: which cells stand for which object, and how well they must.

Cells are assigned by how well class and box already agree with an object (task-aligned
assignment: TOOD, Feng et al. 2021, eq. 3 and 4), boxes are drawn by GIoU (Rezatofighi et al.
2019), classes by cross entropy against the quality of the match.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

__all__ = ["detection_loss"]

_TOP = 8
_SCORE_POWER, _IOU_POWER = 0.5, 4.0
# A cell can stand for an object whose box is smaller than a cell.
_SMALLEST_PX = 12.0
_BOX_WEIGHT = 2.0


def detection_loss(
    logits: Tensor, boxes: Tensor, targets: list[dict[str, Tensor]], centres: Tensor
) -> Tensor:
    """Return the mean loss of a batch.

    Args:
        logits: (B, N, C).
        boxes: (B, N, 4) in pixels.
        targets: For each image `boxes` (K, 4), `classes` (K,) and `ignored` (M, 4).
        centres: (N, 2) of the cells.
    """
    class_loss = logits.new_zeros(())
    box_loss = logits.new_zeros(())
    total = logits.new_zeros(())
    for image_logits, image_boxes, target in zip(logits, boxes, targets, strict=True):
        quality, assigned = _assign(image_logits.detach(), image_boxes.detach(), target, centres)
        wanted = torch.zeros_like(image_logits)
        chosen = assigned >= 0
        if chosen.any():
            truth = target["boxes"][assigned[chosen]]
            wanted[chosen, target["classes"][assigned[chosen]]] = quality[chosen]
            weight = quality[chosen]
            box_loss = box_loss + ((1 - _giou(image_boxes[chosen], truth)) * weight).sum()
        counts = chosen | ~_inside_any(centres, target["ignored"])
        entropy = functional.binary_cross_entropy_with_logits(
            image_logits, wanted, reduction="none"
        )
        # Easy background is turned down (varifocal loss, Zhang et al. 2021, eq. 2).
        modulation = torch.where(wanted > 0, 1.0, 0.75 * image_logits.detach().sigmoid() ** 1.5)
        class_loss = class_loss + (entropy * modulation * counts[:, None]).sum()
        total = total + wanted.sum()
    return (class_loss + _BOX_WEIGHT * box_loss) / total.clamp(min=1.0)


@torch.no_grad()
def _assign(
    logits: Tensor, boxes: Tensor, target: dict[str, Tensor], centres: Tensor
) -> tuple[Tensor, Tensor]:
    """Return for each cell the quality of its match, and its object or -1."""
    truth, classes = target["boxes"], target["classes"]
    cells = len(centres)
    if not len(truth):
        return logits.new_zeros(cells), torch.full((cells,), -1)
    middle = (truth[:, :2] + truth[:, 2:]) / 2
    half = ((truth[:, 2:] - truth[:, :2]) / 2).clamp(min=_SMALLEST_PX / 2)
    inside = ((centres[None] - middle[:, None]).abs() < half[:, None]).all(-1)
    overlap = _iou(truth, boxes)
    scores = logits.sigmoid()[:, classes].T
    metric = scores**_SCORE_POWER * overlap**_IOU_POWER * inside
    top = metric.topk(min(_TOP, cells), dim=1)
    kept = torch.zeros_like(metric).scatter_(1, top.indices, (top.values > 1e-12).float())
    # An object that no cell fits yet is taught to the nearest one.
    lost = kept.sum(1) == 0
    if lost.any():
        distance = (centres[None] - middle[lost][:, None]).square().sum(-1)
        kept[lost] = functional.one_hot(distance.argmin(1), cells).float()
        metric = torch.where((kept > 0) & (metric == 0), torch.full_like(metric, 1e-9), metric)
    metric = metric * kept
    best, assigned = metric.max(0)
    assigned = torch.where(best > 0, assigned, -1)
    best_of = metric.max(1).values.clamp(min=1e-12)
    reach = (overlap * kept).max(1).values.clamp(min=0.1)
    quality = torch.where(assigned >= 0, best / best_of[assigned] * reach[assigned], 0.0)
    return quality.clamp(0, 1), assigned


def _inside_any(centres: Tensor, boxes: Tensor) -> Tensor:
    """Return (N,) whether a cell's centre lies in one of the boxes (M, 4)."""
    if not len(boxes):
        return torch.zeros(len(centres), dtype=torch.bool)
    after = (centres[:, None] > boxes[None, :, :2]).all(-1)
    return (after & (centres[:, None] < boxes[None, :, 2:]).all(-1)).any(1)


def _iou(a: Tensor, b: Tensor) -> Tensor:
    """Return the overlaps (K, N) of boxes (K, 4) and (N, 4)."""
    low = torch.maximum(a[:, None, :2], b[None, :, :2])
    high = torch.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = (high - low).clamp(min=0).prod(-1)
    areas = (a[:, 2:] - a[:, :2]).prod(-1)[:, None] + (b[:, 2:] - b[:, :2]).prod(-1)[None]
    return shared / (areas - shared).clamp(min=1e-6)


def _giou(a: Tensor, b: Tensor) -> Tensor:
    """Return the generalised overlaps (N,) of boxes (N, 4) pair by pair."""
    shared = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0)
    both = shared.prod(-1)
    union = (a[:, 2:] - a[:, :2]).prod(-1) + (b[:, 2:] - b[:, :2]).prod(-1) - both
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(-1)
    return both / union.clamp(min=1e-6) - (hull - union) / hull.clamp(min=1e-6)
