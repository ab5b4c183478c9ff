"""CLEAR-MOT and ID figures against motmetrics, HOTA against trackeval."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from percept.datasets.labels.kitti_tracking import read_kitti_tracks
from percept.datasets.labels.mot import read_mot
from percept.evaluation.tracks.clear import ClearScores, clear_scores, match_over_time
from percept.evaluation.tracks.frames import TrackFrame, pair_frames
from percept.evaluation.tracks.hota import HotaScores, hota_scores
from percept.evaluation.tracks.identity import IdentityScores, identity_scores
from percept.evaluation.tracks.kitti_rules import KittiSequence
from percept.evaluation.tracks.similarity import image_iou, space_iou

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import motmetrics
    from trackeval.metrics import HOTA

_LEAST = 0.5


def _random_frames(seed: int) -> list[TrackFrame]:
    """Objects that come and go, tracks that mostly follow them, gaps, swaps, and frames of none."""
    rng = np.random.default_rng(seed)
    objects, length = int(rng.integers(1, 9)), int(rng.integers(1, 60))
    owners = rng.permutation(objects + 3)
    frames = []
    for _ in range(length):
        if rng.random() < 0.05:
            owners = rng.permutation(owners)
        truth = np.flatnonzero(rng.random(objects) < rng.choice([0.0, 0.8], p=[0.05, 0.95]))
        tracks = np.flatnonzero(rng.random(objects + 3) < rng.choice([0.0, 0.7], p=[0.05, 0.95]))
        similarity = rng.random((len(truth), len(tracks))) ** 3
        right = owners[tracks][None, :] == truth[:, None]
        similarity[right] = rng.uniform(0.3, 1.0, right.sum())
        frames.append(TrackFrame(truth, tracks + 100, similarity))
    return frames


def _of_motmetrics(sequence: Sequence[TrackFrame]) -> dict[str, float]:
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for frame in sequence:
        distance = np.where(frame.similarity >= _LEAST, 1.0 - frame.similarity, np.nan)
        accumulator.update(frame.truth_ids, frame.track_ids, distance)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        row = motmetrics.metrics.create().compute(
            accumulator, metrics=motmetrics.metrics.motchallenge_metrics
        )
    return {name: float(row[name].iloc[0]) for name in row.columns}


def _of_trackeval(sequence: Sequence[TrackFrame]) -> dict[str, Any]:
    names = {
        name: k for k, name in enumerate(sorted({int(i) for f in sequence for i in f.track_ids}))
    }
    objects = {
        name: k for k, name in enumerate(sorted({int(i) for f in sequence for i in f.truth_ids}))
    }
    data = {
        "num_tracker_dets": sum(len(f.track_ids) for f in sequence),
        "num_gt_dets": sum(len(f.truth_ids) for f in sequence),
        "num_gt_ids": len(objects),
        "num_tracker_ids": len(names),
        "gt_ids": [np.array([objects[int(i)] for i in f.truth_ids], int) for f in sequence],
        "tracker_ids": [np.array([names[int(i)] for i in f.track_ids], int) for f in sequence],
        "similarity_scores": [f.similarity for f in sequence],
    }
    result: dict[str, Any] = HOTA().eval_sequence(data)
    return result


@pytest.mark.parametrize("seed", range(40))
def test_clear_and_identity_equal_motmetrics(seed: int) -> None:
    frames = _random_frames(seed)
    clear = clear_scores(frames, match_over_time(frames, _LEAST))
    identity = identity_scores(frames, _LEAST)
    wanted = _of_motmetrics(frames)
    ours = _figures(clear, identity)
    assert {name: wanted[name] for name in ours} == pytest.approx(ours, abs=1e-12, nan_ok=True)


def _figures(clear: ClearScores, identity: IdentityScores) -> dict[str, float]:
    return {
        "mota": clear.mota,
        "motp": clear.motp,
        "precision": clear.precision,
        "recall": clear.recall,
        "num_switches": clear.switches,
        "num_fragmentations": clear.fragmentations,
        "num_false_positives": clear.false_positives,
        "num_misses": clear.misses,
        "mostly_tracked": clear.mostly_tracked,
        "partially_tracked": clear.partially_tracked,
        "mostly_lost": clear.mostly_lost,
        "idf1": identity.idf1,
        "idp": identity.idp,
        "idr": identity.idr,
    }


@pytest.mark.parametrize("seed", range(40))
def test_hota_equals_trackeval(seed: int) -> None:
    frames = _random_frames(seed)
    ours, theirs = hota_scores(frames), _of_trackeval(frames)
    assert _hota(ours) == pytest.approx(
        {name: float(np.mean(theirs[name])) for name in _hota(ours)}, abs=1e-9
    )


def _hota(scores: HotaScores) -> dict[str, float]:
    return {"HOTA": scores.hota, "DetA": scores.det_a, "AssA": scores.ass_a, "LocA": scores.loc_a}


def test_several_sequences_add_up_as_in_trackeval() -> None:
    sequences = [_random_frames(seed) for seed in range(5)]
    ours = sum((hota_scores(frames) for frames in sequences), HotaScores())
    each = {str(k): _of_trackeval(frames) for k, frames in enumerate(sequences)}
    both = HOTA().combine_sequences(each)
    assert _hota(ours) == pytest.approx(
        {name: float(np.mean(both[name])) for name in _hota(ours)}, abs=1e-9
    )


def test_a_sequence_of_motchallenge_has_the_figures_of_motmetrics(shared_data: Path) -> None:
    folder = shared_data / "mot" / "motmetrics_tud"
    wanted = json.loads((folder / "expected_motmetrics.json").read_text())["TUD-Campus"]
    truth, dropped = read_mot(folder / "TUD-Campus" / "gt.txt", labels=True)
    tracks, _ = read_mot(folder / "TUD-Campus" / "test.txt", labels=False)
    assert not dropped
    frames = pair_frames(truth, tracks, image_iou)
    clear = clear_scores(frames, match_over_time(frames, _LEAST))
    ours = _figures(clear, identity_scores(frames, _LEAST))
    assert {name: wanted[name] for name in ours} == pytest.approx(ours, abs=1e-9)
    theirs = _of_trackeval(frames)
    assert hota_scores(frames).hota == pytest.approx(float(np.mean(theirs["HOTA"])), abs=1e-9)


def test_the_objects_that_count_are_those_of_the_published_table(shared_data: Path) -> None:
    """MOTA, FP, FN and IDS of a published row of KITTI give the number of objects back."""
    truths = [
        read_kitti_tracks(path)
        for path in sorted((shared_data / "mot" / "kitti_tracking" / "label_02").glob("*.txt"))
    ]
    for label, mota, wrong in (("Car", 0.8647, 368 + 766), ("Pedestrian", 0.7386, 589 + 1965 + 4)):
        parts = [KittiSequence(t, t.select(t.ids < -1), label, space_iou, 0.25) for t in truths]
        objects = sum(part.objects for part in parts)
        assert 1 - wrong / objects == pytest.approx(mota, abs=5e-5)
