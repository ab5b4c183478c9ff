"""Chosen frames against every n-th frame, as many of them: what is seen of the road and on it.

    python tests/benchmarks/bench_keyframes.py --data ../shared/data --drive DRIVE ...

- Argoverse 2: a real drive of 16 s that comes to a stand, its poses and objects, no images.
- Drives of `percept synth drive`, best some of 30 s of several seeds. As they are; and as logs of
  a town are: each stands for 15 s on its way, its picture with fresh noise, and every second log
  comes a second time, encoded again, brighter and without its beginning. All repeated pictures must
  be found.
- The same with a budget, with the true objects as what networks and tracks say.

Metres of road are those within 2.5 m of a chosen frame; objects are those that it shows. Ends
with 1 where less is seen than by every n-th frame, where logs that stand and repeat do not show
1.2 times as much road, or where a picture is kept twice or lost.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

import cv2
import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from percept.core.samples import CameraImage
from percept.core.trajectory import Trajectory
from percept.core.transform import matrix_from_quat_xyzw
from percept.datasets import open_recording
from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.choice.image_look import ImageLook, look_at
from percept.datasets.labelling.choice.keyframes import KeyframeConfig, choose_instants
from percept.datasets.labelling.choice.selection import Candidate, SelectionConfig, decide
from percept.evaluation.runs import read_poses

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_REACH_M = 2.5
_RANGE_M = 60.0
_STAND = 150
_CUT = 23
_STEP_NS = 100_000_000
_LEAST_VISIBLE = 0.3

_Object = tuple[str, str]


@dataclass(frozen=True)
class _Moment:
    """One frame: where the vehicle truly is along its way, what it sees, how that looks."""

    world: str
    stamp_ns: int
    way_m: float
    objects: frozenset[_Object]
    look: ImageLook | None


@dataclass(frozen=True)
class _Log:
    name: str
    poses: Trajectory
    moments: tuple[_Moment, ...]


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    parser.add_argument("--drive", type=Path, nargs="*", default=[])
    arguments = parser.parse_args()
    scene = arguments.data / "scenes" / "av2" / "7fab2350"
    missed = _compared("Argoverse 2", [_argoverse(scene)], 1.0) if scene.is_dir() else []
    if arguments.drive:
        drives = [_drive(folder, number) for number, folder in enumerate(arguments.drive)]
        missed += _compared("drives", [log for log, _ in drives], 1.0)
        town = [log for _, logs in drives for log in logs]
        missed += _compared("drives that stand and repeat", town, 1.2)
        missed += _budget(town)
    for what in missed:
        print(f"missed: {what}")
    raise SystemExit(bool(missed))


def _compared(title: str, logs: Sequence[_Log], least: float) -> list[str]:
    candidates = _candidates(logs)
    decisions = decide([c for c, _ in candidates], SelectionConfig())
    kept = [m for (_, m), d in zip(candidates, decisions, strict=True) if d.dropped is None]
    everything = [moment for log in logs for moment in log.moments]
    plain = _every_nth(everything, len(kept))
    print(
        f"{title}: {len(everything)} frames, {len(candidates)} decoded, {len(kept)} kept "
        f"({len(kept) / len(everything):.1%}); {_reasons(decisions)}"
    )
    ours, theirs = _content(kept), _content(plain)
    for name in ours:
        gain = ours[name] / theirs[name]
        print(f"  {name:22} {ours[name]:8.0f}  every n-th {theirs[name]:8.0f}  gain {gain:.2f}")
    missed = [f"{title}: objects"] if ours["objects"] < theirs["objects"] else []
    missed += [f"{title}: road"] if ours["road m"] < least * theirs["road m"] else []
    return missed + _repeated(title, [moment for _, moment in candidates], kept)


def _repeated(title: str, decoded: Sequence[_Moment], kept: Sequence[_Moment]) -> list[str]:
    """Print how many pictures were kept twice, and how many not at all though none was like it."""
    pictures = [(m.world, m.way_m) for m in kept if m.look is not None]
    different = {(m.world, m.way_m) for m in decoded if m.look is not None}
    twice, lost = len(pictures) - len(set(pictures)), len(different) - len(set(pictures))
    print(f"  different pictures {len(different)}, kept twice {twice}, lost {lost}")
    return [f"{title}: pictures kept twice or lost"] if twice or lost else []


def _budget(logs: Sequence[_Log]) -> list[str]:
    candidates = _candidates(logs)
    everything = [moment for log in logs for moment in log.moments]
    missed = []
    for budget in (20, 60, 120):
        decisions = decide([c for c, _ in candidates], SelectionConfig(), budget)
        kept = [m for (_, m), d in zip(candidates, decisions, strict=True) if d.dropped is None]
        ours, theirs = _content(kept), _content(_every_nth(everything, len(kept)))
        print(f"  budget of {budget} images, every n-th, gain: ", end="")
        print(
            "  ".join(f"{n} {v:.0f} {theirs[n]:.0f} {v / theirs[n]:.2f}" for n, v in ours.items())
        )
        missed += [f"budget of {budget}: {n}" for n, v in ours.items() if v < theirs[n]]
    return missed


def _candidates(logs: Sequence[_Log]) -> list[tuple[Candidate, _Moment]]:
    found: list[tuple[Candidate, _Moment]] = []
    for log in logs:
        earlier = np.array([candidate.keyframe_ns for candidate, _ in found], np.int64)
        by_stamp = {moment.stamp_ns: moment for moment in log.moments}
        stamps = np.array(sorted(by_stamp), np.int64)
        for instant in choose_instants(stamps, log.poses, KeyframeConfig(), (), earlier):
            moment = by_stamp[instant.stamp_ns]
            seen = sorted(moment.objects)
            evidence = FrameEvidence(
                stamp_ns=moment.stamp_ns,
                labels=tuple(label for label, _ in seen),
                confidences=np.ones(len(seen)),
                track_ids=np.array([int(t) for _, t in seen], np.int64),
            )
            candidate = Candidate(
                drive=log.name, camera="front", stamp_ns=moment.stamp_ns,
                keyframe_ns=moment.stamp_ns, look=moment.look, evidence=evidence,
            )  # fmt: skip
            found.append((candidate, moment))
    return found


def _every_nth(moments: Sequence[_Moment], count: int) -> list[_Moment]:
    return [moments[i * len(moments) // count] for i in range(count)]


def _reasons(decisions: Sequence[Any]) -> str:
    counts = Counter(d.dropped for d in decisions if d.dropped is not None)
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items())) or "none dropped"


def _content(moments: Sequence[_Moment]) -> dict[str, float]:
    """Return metres of road and the number of objects."""
    seen = {(m.world, thing) for m in moments for thing in m.objects}
    road = 0.0
    for world in {m.world for m in moments}:
        end = -np.inf
        for way in sorted(m.way_m for m in moments if m.world == world):
            road += min(2 * _REACH_M, way + _REACH_M - end)
            end = way + _REACH_M
    return {"road m": road, "objects": float(len(seen))}


@dataclass(frozen=True)
class _Way:
    """Where a vehicle was at frames 0.1 s apart, and what it saw."""

    world: str
    places: NDArray[np.float64]
    objects: tuple[frozenset[_Object], ...]
    start_ns: int = 0

    def log(
        self, name: str, looks: Sequence[ImageLook | None], frames: Sequence[int] | None = None
    ) -> _Log:
        """Return a log of frames, any number of times each, with a look for each of them."""
        order = list(range(len(self.places)) if frames is None else frames)
        steps = np.linalg.norm(np.diff(self.places[:, :3, 3], axis=0), axis=1)
        ways = np.concatenate([[0.0], np.cumsum(steps)])
        stamps = np.arange(len(order), dtype=np.int64) * _STEP_NS + self.start_ns
        moments = [
            _Moment(self.world, int(stamp), float(ways[i]), self.objects[i], look)
            for stamp, i, look in zip(stamps, order, looks, strict=True)
        ]
        poses = Trajectory("map", "base_link", stamps, self.places[order])
        return _Log(name, poses, tuple(moments))


def _drive(folder: Path, number: int) -> tuple[_Log, list[_Log]]:
    """Return a drive as it is, and as logs of a town."""
    images = [s for s in open_recording(folder / "drive.mcap").samples() if _is_image(s)]
    stamps = np.array([image.stamp_ns for image in images], np.int64)
    places, known = read_poses(folder / "truth" / "poses.parquet").poses_at(stamps)
    shown = _boxes(folder / "truth" / "boxes_2d.parquet")
    seen = tuple(shown.get(int(stamp), frozenset()) for stamp in stamps[known])
    way = _Way(folder.name, places[known], seen, number * 10**12)
    pictures = [image.pixels for image, there in zip(images, known, strict=True) if there]
    looks = [look_at(picture) for picture in pictures]
    at, noise = len(pictures) // 3, np.random.default_rng(number)
    stand = [_noisy(pictures[at], noise) for _ in range(_STAND)]
    frames = [*range(at), *[at] * _STAND, *range(at, len(pictures))]
    town_looks = [*looks[:at], *(look_at(picture) for picture in stand), *looks[at:]]
    town = [way.log(folder.name, town_looks, frames)]
    if number % 2 == 0:
        again = [*pictures[:at], *stand, *pictures[at:]]
        again_looks = [look_at(_encoded_again(picture)) for picture in again]
        whole = way.log(f"{folder.name} again", again_looks, frames)
        town.append(_cut(whole))
    return way.log(folder.name, looks), town


def _cut(log: _Log) -> _Log:
    """Return a log without its beginning."""
    poses = Trajectory("map", "base_link", log.poses.stamps_ns[_CUT:], log.poses.matrices[_CUT:])
    return _Log(log.name, poses, log.moments[_CUT:])


def _is_image(sample: object) -> TypeGuard[CameraImage]:
    return isinstance(sample, CameraImage)


def _noisy(picture: NDArray[np.uint8], noise: np.random.Generator) -> NDArray[np.uint8]:
    grain = noise.normal(0.0, 3.0, picture.shape)
    return np.clip(picture + grain, 0, 255).astype(np.uint8)


def _encoded_again(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    brighter = cv2.convertScaleAbs(picture, alpha=1.1, beta=5)
    _, encoded = cv2.imencode(".jpg", brighter, [cv2.IMWRITE_JPEG_QUALITY, 60])
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), np.uint8)


def _boxes(path: Path) -> dict[int, frozenset[_Object]]:
    found: dict[int, set[_Object]] = {}
    columns = ["stamp_ns", "label", "track_id", "visible"]
    for row in pq.read_table(path, columns=columns).to_pylist():
        if row["visible"] >= _LEAST_VISIBLE:
            found.setdefault(row["stamp_ns"], set()).add((row["label"], str(row["track_id"])))
    return {stamp: frozenset(things) for stamp, things in found.items()}


def _argoverse(scene: Path) -> _Log:
    with (scene / "city_SE3_egovehicle_at_annotations.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    places = np.tile(np.eye(4), (len(rows), 1, 1))
    for place, row in zip(places, rows, strict=True):
        place[:3, :3] = matrix_from_quat_xyzw([float(row[f"q{axis}"]) for axis in "xyzw"])
        place[:3, 3] = [float(row[f"t{axis}_m"]) for axis in "xyz"]
    seen: dict[str, set[_Object]] = {row["frame"]: set() for row in rows}
    with (scene / "annotations.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            near = np.hypot(float(row["x"]), float(row["y"])) <= _RANGE_M
            if near and int(row["npts"]) > 0:
                seen[row["frame"]].add((row["category"], row["track"]))
    way = _Way("av2", places, tuple(frozenset(things) for things in seen.values()))
    return way.log("av2", [None] * len(rows))


if __name__ == "__main__":
    main()
