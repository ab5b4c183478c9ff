"""A finished run as a source of labels: what it says of any time, and of its log."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_run import CAMERA, IMAGE_DELAY_NS, make_run
from made_tracks import START_NS, STEP_NS, make_tracks

from percept.cli.dataset.run_labels import RunLabels, RunLog
from percept.core.errors import InputError
from percept.core.transform import Transform
from percept.datasets.labelling.prelabels.label_keyframe import ImageView, PreLabelConfig, link


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunLabels:
    return RunLabels.open(make_run(tmp_path_factory.mktemp("made") / "run"))


def test_log_rig_and_networks_are_known(run: RunLabels) -> None:
    assert run.logs == (RunLog(path=Path("logs/drive"), contents=frozenset({"10:aa", "12:bb"})),)
    assert run.models == {"a": "a.onnx cc", "b": "b.onnx dd"}
    assert run.rig.cameras()["front"].K == CAMERA.K


def test_tracks_at_any_time_in_the_frame_of_the_vehicle(run: RunLabels) -> None:
    stamp_ns = START_NS + 3 * STEP_NS + STEP_NS // 2
    solids = run.solids(stamp_ns)
    expected = (make_tracks(3).boxes_m[:2, 0] + make_tracks(4).boxes_m[:2, 0]) / 2 - 3.5
    assert solids.boxes_m[:, 0] == pytest.approx(expected)
    assert solids.track_ids.tolist() == [1, 2]
    assert len(run.solids(stamp_ns, trial=True)) == 3
    assert not len(run.solids(START_NS + 60 * STEP_NS))


def test_times_can_be_asked_in_any_order(run: RunLabels) -> None:
    times = [START_NS + step * STEP_NS for step in (9, 1, 5, 1)]
    found = [run.solids(stamp).boxes_m[0, 0] for stamp in times]
    assert found == pytest.approx([10 + 0.2 * step - step for step in (9, 1, 5, 1)])


def test_boxes_of_each_network_by_its_name(run: RunLabels) -> None:
    found = run.image_boxes("front", START_NS + STEP_NS + IMAGE_DELAY_NS)
    assert list(found) == ["a", "b"]
    assert found["a"].labels == ("traffic light red", "person")
    assert found["b"].labels == ("person",)
    assert run.image_boxes("front", START_NS) == {}
    assert run.image_boxes("rear", START_NS + IMAGE_DELAY_NS) == {}


def test_networks_with_classes_in_another_order_agree_on_the_person(run: RunLabels) -> None:
    stamp_ns = START_NS + IMAGE_DELAY_NS
    view = ImageView(found=run.image_boxes("front", stamp_ns), image_size=(400, 200))
    boxes = link(view, run.solids(stamp_ns), PreLabelConfig())
    named = dict(zip(boxes.labels, boxes.sources, strict=True))
    assert named == {"traffic_light_red": "a", "pedestrian": "b"}


def test_evidence_is_of_each_second(run: RunLabels) -> None:
    evidence = run.evidence()
    assert [one.stamp_ns - START_NS for one in evidence] == [0, 10 * STEP_NS]
    labels = evidence[0].labels
    assert sorted(labels) == ["car", "pedestrian", "pedestrian", "traffic_light_red"]
    assert run.evidence() is evidence


def test_evidence_knows_who_did_not_see_what(run: RunLabels) -> None:
    """`b` knows lights and missed one, no track is where the person is, no network saw tracks."""
    (first, _) = run.evidence()
    assert first.disagreement == 1.0
    assert sorted(first.confidences.tolist()) == pytest.approx([0.7, 0.75, 0.8, 0.9])


def test_run_without_tracks_has_the_boxes_of_its_scans(tmp_path: Path) -> None:
    run = RunLabels.open(make_run(tmp_path / "run", steps=3, tracks=False))
    solids = run.solids(START_NS + STEP_NS + 30_000_000)
    assert (solids.labels, solids.sources) == (("car",), ("lidar",))
    assert solids.points.tolist() == [40]
    assert solids.track_ids.tolist() == [-1]
    assert not len(run.solids(START_NS + 9 * STEP_NS))


def test_tracks_without_poses_have_no_place(tmp_path: Path) -> None:
    run = RunLabels.open(make_run(tmp_path / "run", steps=3, poses=False))
    assert run.trajectory is None
    assert not len(run.solids(START_NS))
    assert run.dropped == {"moments without a pose, which have no 3D boxes": 1}
    known = Transform("map", "base", np.eye(4) + 2 * np.eye(4, k=3))
    assert run.solids(START_NS, known).boxes_m[0, 0] == pytest.approx(8)


@pytest.mark.parametrize("kept", [(), ("run.json",)])
def test_folder_that_is_no_run_is_refused(tmp_path: Path, kept: tuple[str, ...]) -> None:
    folder = make_run(tmp_path / "run", steps=2)
    for path in list(folder.iterdir()):
        if path.name not in kept:
            path.unlink()
    with pytest.raises(InputError, match="run"):
        RunLabels.open(folder)


def test_log_is_found_where_the_command_does_not_name_it(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run", steps=2)
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(record | {"command": ["percept", "demo"]}))
    paths = [log.path.name for log in RunLabels.open(folder).logs]
    assert paths == ["drive_0.mcap", "drive_1.mcap"]


def test_stamps_stay_whole_numbers(run: RunLabels) -> None:
    assert run.images is not None
    assert run.images.stamps_ns("front").dtype == np.int64
    assert run.images.nearest("front", START_NS) == START_NS + IMAGE_DELAY_NS
