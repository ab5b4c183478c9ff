"""What a session put into a view, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["IMAGES_PER_FLUSH", "SCANS_PER_FLUSH", "ViewSummary"]

# A chunk an entity for so many: few chunks, and a killed process loses no more of its view.
SCANS_PER_FLUSH = 16
IMAGES_PER_FLUSH = 64


@dataclass(frozen=True, slots=True)
class ViewSummary:
    """What a session put into the view.

    Attributes:
        frames: Scans that were given; all are in the plots.
        drawn: Scans whose points and boxes are drawn.
        frame_stride: One scan of a sensor in so many is drawn.
        points_per_frame: Most points that are drawn of one scan.
        resumed: Whether an earlier session's parts came before.
        unreadable_parts: Parts of earlier sessions that could not be read and are left out.
        images: Images that were given; all are in the plots.
        images_drawn: Images that are drawn with their boxes.
        image_stride: One image of a camera in so many is drawn.
    """

    frames: int
    drawn: int
    frame_stride: int
    points_per_frame: int
    resumed: bool = False
    unreadable_parts: int = 0
    images: int = 0
    images_drawn: int = 0
    image_stride: int = 1

    def scans_text(self) -> str:
        """Return what is drawn of the scans as a sentence."""
        return (
            f"The 3D view draws {_every(self.frame_stride, 'frame')} of each sensor with at most "
            f"{self.points_per_frame:,} evenly taken points; the plots hold all frames."
        )

    def images_text(self) -> str:
        """Return what is drawn of the images as a sentence."""
        return (
            f"The view draws {_every(self.image_stride, 'image')} of each camera, those wider than "
            "640 pixels at half their size; the plots hold all images."
        )

    def as_text(self) -> str:
        """Return the summary as sentences."""
        parts = [self.scans_text()] if self.frames or not self.images else []
        if self.images:
            parts.append(self.images_text())
        if self.resumed:
            parts.append(
                f"Up to {SCANS_PER_FLUSH} scans and {IMAGES_PER_FLUSH} images before the run was "
                "resumed may be missing."
            )
        if self.unreadable_parts:
            parts.append(f"{self.unreadable_parts} parts of earlier sessions could not be read.")
        return " ".join(parts)


def _every(stride: int, what: str) -> str:
    return f"every {what}" if stride == 1 else f"one {what} in {stride}"
