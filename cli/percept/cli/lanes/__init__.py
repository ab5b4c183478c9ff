"""`percept lanes`: lines of the lane in images."""

from percept.cli.lanes.command import lanes

__all__ = ["lanes"]
