"""What the front camera of a synthetic drive shows of the road, rendered where it is needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import PaintObservation
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.synthetic.drive import MAP_ORIGIN, START_NS, Drive, DriveConfig
from percept.datasets.synthetic.lanelet_map import StreetMap, make_map
from percept.datasets.synthetic.map_changes import MapChange, plan_changes, plant_changes
from percept.datasets.synthetic.map_sight import DriveSight
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.lanes import ground_from_points, observe_paint

BLOCKS = range(-2, 6)
_SPACING_M = 1.2
_GROUND_M = 40.0
_BOXES_M = 50.0


@dataclass(frozen=True, eq=False)
class RoadDrive:
    """A drive without a log: its poses, and what its front camera shows.

    Attributes:
        drive: The drive.
        poses: True poses.
    """

    drive: Drive
    poses: Trajectory

    @classmethod
    def of(cls, seed: int, seconds: float, noise: float) -> RoadDrive:
        """Return the drive of a seed."""
        drive = Drive(DriveConfig(seed=seed, seconds=seconds, noise=noise))
        until_ns = START_NS + drive.duration_ns
        return cls(drive, drive.ego.trajectory(np.arange(START_NS, until_ns, 10_000_000)))

    def looks(self) -> Iterator[PaintObservation]:
        """Yield the paint in images some metres apart, with the true ground and true boxes."""
        camera, last_m = self.drive.cameras[0], -np.inf
        number = 0
        while (stamp_ns := self.drive.image_stamp_ns(camera, number)) <= self.poses.stamps_ns[-1]:
            T_map_base = self.poses.at(stamp_ns)
            assert T_map_base is not None
            x_m = float(T_map_base.translation_m[0])
            if x_m - last_m >= _SPACING_M:
                last_m = x_m
                yield observe_paint(
                    self.drive.picture(camera, number)[0],
                    camera,
                    stamp_ns=stamp_ns,
                    ground=ground_from_points(self._ground(T_map_base)),
                    occluders=self._boxes(T_map_base, stamp_ns),
                )
            number += 1

    def maps(self, changes: int) -> tuple[StreetMap, StreetMap, list[MapChange]]:
        """Return the true map, a changed one, and what was changed."""
        config, world = self.drive.config, self.drive.world
        sight = DriveSight(world, self.drive.ego, self.drive.cameras[0], config.seconds)
        street = make_map(world, MAP_ORIGIN, BLOCKS)
        sites = plan_changes(sight, lambda _: BLOCKS, changes)
        planted = plant_changes(street, sight, sites, config.seed)
        return make_map(world, MAP_ORIGIN, BLOCKS), street, planted

    def _ground(self, T_map_base: Transform) -> NDArray[np.float64]:
        """Return points of the road around the vehicle in its frame, as LiDARs would have them."""
        x0 = float(T_map_base.translation_m[0])
        x, y = np.meshgrid(np.arange(x0 - 5, x0 + _GROUND_M, 0.25), np.arange(-9.0, 4.0, 0.5))
        z = self.drive.world.profile.height(x)
        return T_map_base.inverse().apply(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))

    def _boxes(self, T_map_base: Transform, stamp_ns: int) -> NDArray[np.float64]:
        """Return boxes (N, 7) of what stands and moves on the street, in the vehicle's frame."""
        world, time_s = self.drive.world, float(self.drive.ego.seconds(stamp_ns))
        rows = []
        for placed in world.objects(time_s, float(T_map_base.translation_m[0]), _BOXES_M):
            if placed.shape.label not in DETECTABLE:
                continue
            shape = placed.shape
            middle = world.place(placed, time_s) @ np.append(shape.middle, 1.0)
            centre = T_map_base.inverse().apply(middle[None, :3])[0]
            turned = placed.yaw_rad - np.arctan2(*T_map_base.rotation[[1, 0], 0])
            rows.append([*centre, shape.length_m, shape.width_m, shape.height_m, turned])
        return np.array(rows, dtype=np.float64).reshape(-1, 7)
