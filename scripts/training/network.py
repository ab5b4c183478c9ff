"""A small anchor-free detector: a convolutional pyramid with decoupled heads.

In the style of YOLOX (Ge et al. 2021) and YOLOv8: residual stages, features of strides 8, 16
and 32 joined from the top down, and one head for classes and one for boxes at each stride. A
box is told by the distances from a cell's centre to its four sides (FCOS, Tian et al. 2019).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

__all__ = ["STRIDES", "Detector", "cell_centres"]

STRIDES = (8, 16, 32)
_WIDTHS = (16, 32, 64, 96, 128)
_NECK = 64
_PRIOR = -4.6  # a cell is of a class with 1 % at the start (RetinaNet, Lin et al. 2017, 4.1)


def conv(inputs: int, outputs: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    """Return convolution, normalisation and activation."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
        nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.03),
        nn.SiLU(inplace=True),
    )


class Residual(nn.Module):
    """Two convolutions through half the width, added to the input."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.body = nn.Sequential(conv(width, width // 2, 1), conv(width // 2, width))

    def forward(self, x: Tensor) -> Tensor:
        """Return features of the same shape."""
        return x + self.body(x)


class Context(nn.Module):
    """Pools over growing windows, so that large objects are seen whole (SPPF of YOLOv5)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.squeeze = conv(width, width // 2, 1)
        self.pool = nn.MaxPool2d(5, 1, 2)
        self.join = conv(2 * width, width, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Return features of the same shape."""
        parts = [self.squeeze(x)]
        for _ in range(3):
            parts.append(self.pool(parts[-1]))
        return self.join(torch.cat(parts, 1))


class Head(nn.Module):
    """Classes and box sides of every cell at one stride."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.of_class = nn.Sequential(conv(_NECK, _NECK), nn.Conv2d(_NECK, classes, 1))
        self.of_sides = nn.Sequential(conv(_NECK, _NECK), nn.Conv2d(_NECK, 4, 1))
        nn.init.constant_(self.of_class[-1].bias, _PRIOR)
        nn.init.constant_(self.of_sides[-1].bias, 0.5)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (B, C, H, W) and logarithms of the sides in strides (B, 4, H, W)."""
        return self.of_class(x), self.of_sides(x)


class Detector(nn.Module):
    """The network.

    Args:
        classes: Number of classes.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        a, b, c, d, e = _WIDTHS
        self.stem = nn.Sequential(conv(3, a, 3, 2), conv(a, b, 3, 2), Residual(b))
        self.to_8 = nn.Sequential(conv(b, c, 3, 2), Residual(c), Residual(c))
        self.to_16 = nn.Sequential(conv(c, d, 3, 2), Residual(d), Residual(d))
        self.to_32 = nn.Sequential(conv(d, e, 3, 2), Residual(e), Context(e))
        self.lateral = nn.ModuleList(conv(width, _NECK, 1) for width in (c, d, e))
        self.smooth = nn.ModuleList(conv(_NECK, _NECK) for _ in STRIDES)
        self.heads = nn.ModuleList(Head(classes) for _ in STRIDES)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (B, N, C) and boxes (B, N, 4) x1, y1, x2, y2 in pixels.

        Args:
            images: (B, 3, H, W) RGB 0..1; H and W are multiples of 32.
        """
        eighth = self.to_8(self.stem(images))
        sixteenth = self.to_16(eighth)
        top = self.to_32(sixteenth)
        third = self.lateral[2](top)
        second = self.lateral[1](sixteenth) + functional.interpolate(third, scale_factor=2.0)
        first = self.lateral[0](eighth) + functional.interpolate(second, scale_factor=2.0)
        logits, boxes = [], []
        levels = zip(STRIDES, (first, second, third), self.smooth, self.heads, strict=True)
        for stride, features, smooth, head in levels:
            of_class, of_sides = head(smooth(features))
            centres = cell_centres(of_sides.shape[2], of_sides.shape[3], stride)
            sides = of_sides.flatten(2).transpose(1, 2).float().clamp(-6.0, 6.0).exp() * stride
            logits.append(of_class.flatten(2).transpose(1, 2).float())
            boxes.append(torch.cat([centres - sides[..., :2], centres + sides[..., 2:]], -1))
        return torch.cat(logits, 1), torch.cat(boxes, 1)


def cell_centres(rows: int, columns: int, stride: int) -> Tensor:
    """Return the centres (rows * columns, 2) x, y of a grid's cells, pixels."""
    y, x = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    return (torch.stack([x, y], -1).reshape(-1, 2).float() + 0.5) * stride
