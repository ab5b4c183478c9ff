"""Traffic lights over time: boxes of single images in, the states of all lights out."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import UsageError
from percept.core.results import Detections2D, LightStates
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.hdmap.light import MapLight
from percept.lights.beliefs import Beliefs, Sightings, observe, predict
from percept.lights.boxes import BoxTracks, follow_boxes
from percept.lights.chain import LightChain
from percept.lights.config import LightConfig
from percept.lights.decision import decide
from percept.lights.groups import fuse_groups, light_groups
from percept.lights.sight import LightBoxes, light_boxes, match_to_map
from percept.lights.smooth import smoothed_beliefs
from percept.lights.states import LightStateSpace

__all__ = ["LightTracker"]


@dataclass(slots=True, eq=False)
class _Step:
    """One image and all that was known after it; a rewind cuts the list of steps."""

    image: LightBoxes
    sightings: Sightings
    beliefs: Beliefs
    tracks: Mapping[str, BoxTracks]
    next_id: int
    dropped: Counter[str]

    @property
    def key(self) -> tuple[int, str]:
        return self.image.stamp_ns, self.image.camera


class LightTracker:
    """Follows lights through the images of all cameras.

    With lights of a map, poses and the rig, boxes are matched to the lights that project near
    them, and all cameras tell of the same lights. Without, each camera follows its own boxes.
    What a light shows comes from a hidden Markov model (`percept.lights.chain`).

    What it cannot tell: where an arrow points; lights for pedestrians and trams; a lamp whose
    pulses beat with the shutter for more than a second, which looks as if it flashed or were
    dark; flashing below `slowest_hz` readings a second (`notes` says so); flashing green.

    Args:
        config: Settings.
        lights: Lights of the map; none for following boxes only.
        cameras: The cameras of the rig by name; needed with a map.
        poses: Poses `T_map_base` of the vehicle; needed with a map.

    Raises:
        UsageError: If there are lights of a map, but no cameras or poses.
    """

    def __init__(
        self,
        config: LightConfig | None = None,
        *,
        lights: Sequence[MapLight] = (),
        cameras: Mapping[str, CameraSensor] | None = None,
        poses: Trajectory | None = None,
    ) -> None:
        if lights and (not cameras or poses is None):
            raise UsageError("lights of a map need the cameras of a rig and poses")
        self.config = config or LightConfig()
        self._lights = tuple(lights)
        self._rig = dict(cameras or {})
        self._poses = poses
        self._groups = light_groups(lights) if self.config.fuse_groups else {}
        self._chain = LightChain(LightStateSpace(self.config))
        self._death_s = self.config.death_s if lights else self.config.box_death_s
        self._cameras: list[str] = []
        self._steps: list[_Step] = []
        self._settled = 0
        self._dropped: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """What could not be used, counted by reason."""
        return sum((step.dropped for step in self._steps if step.dropped), self._dropped.copy())

    @property
    def notes(self) -> tuple[str, ...]:
        """What limits the answers, a sentence each."""
        last = {
            light: (count, interval)
            for step in self._steps
            for light, count, interval in zip(
                step.beliefs.ids.tolist(),
                step.beliefs.detections.tolist(),
                step.beliefs.interval_s.tolist(),
                strict=True,
            )
        }
        slowest = self.config.decision.slowest_hz
        slow = sum(
            count >= self.config.birth_detections and interval > 1 / slowest
            for count, interval in last.values()
        )
        if not slow:
            return ()
        return (
            f"{slow} of {len(last)} lights were read less than {slowest:g} times a second: "
            "whether they flash cannot be told",
        )

    def push(self, detections: Detections2D) -> None:
        """Take the boxes of one image; also none, which says that no light was seen.

        An image that is older than others is put in its place, and what followed is done again,
        if it is no more than `reorder_s` late; otherwise it is counted in `dropped`.

        Raises:
            ConfigError: If there is a map, and the rig does not say where the camera sits.
        """
        newest_ns = self._steps[-1].image.stamp_ns if self._steps else detections.stamp_ns
        if newest_ns - detections.stamp_ns > round(self.config.reorder_s * 1e9):
            self._dropped["image came later than the reorder window"] += 1
            return
        if detections.camera not in self._cameras:
            self._cameras.append(detections.camera)
        image, broken = light_boxes(detections, self.config.detector)
        self._dropped += broken
        place = bisect_right(self._steps, (image.stamp_ns, image.camera), key=lambda step: step.key)
        followed = [step.image for step in self._steps[place:]]
        del self._steps[place:]
        for following in [image, *followed]:
            self._steps.append(self._after(following))
        self._forget_tracks(newest_ns)

    def lights(self, stamp_ns: int) -> LightStates:
        """Return all lights as the images up to a time tell, predicted to it; for any time."""
        place = bisect_right(self._steps, stamp_ns, key=lambda step: step.image.stamp_ns)
        if not place:
            return self._answer(Beliefs.none(self._chain.space))
        last = self._steps[place - 1].beliefs
        return self._answer(predict(last, stamp_ns, self._chain, self._death_s))

    def history(self, *, smoothed: bool | None = None) -> Iterator[LightStates]:
        """Yield the lights at the time of each image, in order, where there are any.

        Args:
            smoothed: With hindsight: each answer rests on all images before and after it, so that
                it has no delay, and a light is there from its first box on. Without, it is
                that of `lights`, as the car would have known. As the settings say if it is not
                given.
        """
        beliefs = [step.beliefs for step in self._steps]
        born = None
        if self.config.smoothed if smoothed is None else smoothed:
            born = self._ever_born()
            beliefs = smoothed_beliefs(
                [(step.beliefs, step.sightings) for step in self._steps], self._chain
            )
        for number, one in enumerate(beliefs):
            last = number + 1 == len(beliefs) or beliefs[number + 1].stamp_ns > one.stamp_ns
            if last and len(states := self._answer(one, born)):
                yield states

    def _ever_born(self) -> NDArray[np.int64]:
        """Return the ids of the lights that ever had the detections that a light needs."""
        least = self.config.birth_detections
        found = [step.beliefs.ids[step.beliefs.detections >= least] for step in self._steps]
        return np.unique(np.concatenate([np.zeros(0, np.int64), *found]))

    def _forget_tracks(self, newest_ns: int) -> None:
        """Drop the box tracks of steps that no rewind can come back to."""
        oldest_ns = newest_ns - round(self.config.reorder_s * 1e9)
        while (
            self._settled + 1 < len(self._steps)
            and self._steps[self._settled + 1].image.stamp_ns < oldest_ns
        ):
            self._steps[self._settled].tracks = {}
            self._settled += 1

    def _after(self, image: LightBoxes) -> _Step:
        """Return the step that an image makes after the last one."""
        dropped: Counter[str] = Counter()
        last = self._steps[-1] if self._steps else None
        tracks = dict(last.tracks) if last else {}
        next_id = last.next_id if last else 1
        if self._lights:
            ids = self._match(image, dropped)
        else:
            tracks[image.camera], ids = follow_boxes(
                tracks.get(image.camera, BoxTracks()),
                image.stamp_ns, image.boxes_px, next_id, round(self._death_s * 1e9),
            )  # fmt: skip
            next_id = max(next_id, int(ids.max(initial=0)) + 1)
        known = np.flatnonzero(ids >= 0)
        sightings = Sightings(
            image.stamp_ns, self._cameras.index(image.camera), ids[known],
            image.readings[known], image.weights[known],
        )  # fmt: skip
        before = last.beliefs if last else Beliefs.none(self._chain.space)
        predicted = predict(before, image.stamp_ns, self._chain, self._death_s)
        beliefs = observe(predicted, sightings, self._chain, self.config.decision)
        return _Step(image, sightings, beliefs, tracks, next_id, dropped)

    def _match(self, image: LightBoxes, dropped: Counter[str]) -> NDArray[np.int64]:
        """Return the map's light of each box, -1 for none, and count what has none."""
        nothing = np.full(len(image.boxes_px), -1, np.int64)
        camera = self._rig.get(image.camera)
        if camera is None:
            dropped[f"image of camera '{image.camera}', which is not in the rig"] += 1
            return nothing
        pose = self._poses.at(image.stamp_ns) if self._poses else None
        if pose is None:
            dropped["image at a time without a pose"] += 1
            return nothing
        if not len(image.boxes_px):
            return nothing
        ids = match_to_map(image, self._lights, pose, camera, self.config)
        if spare := int((ids < 0).sum()):
            dropped["light box where the map has no light"] += spare
        return ids

    def _answer(self, beliefs: Beliefs, born: NDArray[np.int64] | None = None) -> LightStates:
        """Return the states of the lights that are born by now, or of those that are given."""
        config = self.config
        is_born = beliefs.detections >= config.birth_detections
        reported = beliefs.subset(is_born if born is None else np.isin(beliefs.ids, born))
        classes = reported.posteriors.astype(np.float64) @ self._chain.space.to_classes
        if self._groups:
            classes = fuse_groups(
                classes,
                np.array([self._groups[light] for light in reported.ids.tolist()]),
                reported.seen_ns,
                self._chain.space.prior @ self._chain.space.to_classes,
                round(config.recent_s * 1e9),
            )
        answers = decide(
            classes,
            config.decision,
            may_flash=reported.may_flash(config.decision),
            flashed=reported.flashed,
        )
        recent = reported.stamp_ns - reported.seen_by_ns <= round(config.recent_s * 1e9)
        return LightStates(
            stamp_ns=reported.stamp_ns,
            ids=reported.ids,
            states=answers.states,
            flashing=answers.flashing,
            probabilities=answers.probabilities,
            cameras=tuple(
                tuple(sorted(self._cameras[number] for number in np.flatnonzero(row)))
                for row in recent
            ),
        )
