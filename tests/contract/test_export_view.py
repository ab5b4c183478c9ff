"""What `view.rrd` holds, read back by rerun's own reader and checker."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from percept.core.errors import DependencyError, GeometryError, InputError
from percept.core.transform import Transform
from percept.export.view import ViewWriter, merge_views
from percept.export.viewer import open_view
from percept.lidar.result import ScanResult

MakeScan = Callable[..., ScanResult]


def _rows_by_entity(path: Path) -> Counter[str]:
    rows: Counter[str] = Counter()
    for chunk in RrdReader(path).stream():
        rows[chunk.entity_path] += chunk.num_rows
    return rows


def _rrd(*arguments: object) -> int:
    """Run rerun's own checker."""
    code = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "rrd", *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True).returncode


class TestView:
    T_base_lidar = Transform.from_quat_xyzw("base_link", "lidar_top", [1, 0, 2], [0, 0, 0, 1])

    def write(self, path: Path, scans: list[ScanResult]) -> None:
        with ViewWriter(path, run_id="r", T_root_frames=[self.T_base_lidar]) as view:
            for i, scan in enumerate(scans):
                view.add(i, scan)

    def test_holds_frames_plots_and_layout(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        scans = [make_scan(0), make_scan(1, boxes=1), make_scan(2, sensor="left")]
        self.write(path, scans)
        assert _rrd("verify", path) == 0
        rows = _rows_by_entity(path)
        assert rows["/world/lidar_top/top/cloud"] == 2
        assert rows["/world/lidar_top/top/boxes"] == 2
        assert rows["/world/lidar_top/top/unknown"] == 2
        assert rows["/world/lidar_left/left/boxes"] == 1
        assert rows["/world/lidar_top"] == 1  # where the sensor sits
        assert rows["/plots/objects/top/car"] == 3  # the name of the line and two values
        assert rows["/plots/objects/top/pedestrian"] == 3  # silent in the second frame: 0
        assert rows["/plots/milliseconds/left/ground"] == 2
        assert rows["/notes"] == 2  # what is drawn; frame lidar_left is not connected
        reader = RrdReader(path)
        assert [entry.application_id for entry in reader.blueprints()] == ["percept"]
        assert [entry.recording_id for entry in reader.recordings()] == ["r"]
        assert list(tmp_path.iterdir()) == [path]

    def test_boxes_keep_place_turn_and_words(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        scan = make_scan(0)
        self.write(path, [scan])
        entity = "/world/lidar_top/top/boxes"
        chunk = next(c for c in RrdReader(path).stream() if c.entity_path == entity)
        row = {name: value[0] for name, value in chunk.to_record_batch().to_pydict().items()}
        boxes = scan.detections.boxes_m[:2]  # the third is unknown
        assert np.allclose(row["Boxes3D:centers"], boxes[:, :3], atol=1e-5)
        assert np.allclose(row["Boxes3D:half_sizes"], boxes[:, 3:6] / 2, atol=1e-5)
        half_yaw = boxes[0, 6] / 2
        assert np.allclose(
            row["Boxes3D:quaternions"][0], [0, 0, np.sin(half_yaw), np.cos(half_yaw)], atol=1e-6
        )
        assert row["Boxes3D:labels"][0] == f"car {scan.detections.confidences[0]:.2f}"
        assert row["frame"] == 0
        assert "log_time" not in row

    def test_the_same_run_gives_the_same_view(self, make_scan: MakeScan, tmp_path: Path) -> None:
        for name in ("a", "b"):
            self.write(tmp_path / f"{name}.rrd", [make_scan(i) for i in range(3)])
        self.write(tmp_path / "c.rrd", [make_scan(i) for i in range(1, 4)])
        assert _rrd("compare", tmp_path / "a.rrd", tmp_path / "b.rrd") == 0
        assert _rrd("compare", tmp_path / "a.rrd", tmp_path / "c.rrd") != 0

    def test_points_and_frames_are_thinned_to_the_budget(
        self, make_scan: MakeScan, tmp_path: Path
    ) -> None:
        path = tmp_path / "view.rrd"
        budget = 3 * 40_000 * 16
        with ViewWriter(path, run_id="r", frames_expected=8, budget_bytes=budget) as view:
            for i in range(8):
                view.add(i, make_scan(i, points=50_000, sensor=("top", "left")[i % 2]))
            summary = view.close()
        assert (summary.frames, summary.frame_stride, summary.drawn) == (8, 3, 4)
        assert "one frame in 3 of each sensor" in summary.as_text()
        rows = _rows_by_entity(path)
        assert rows["/world/lidar_top/top/cloud"] == rows["/world/lidar_left/left/cloud"] == 2
        assert rows["/plots/objects/top/car"] == 1 + 4
        clouds = [c for c in RrdReader(path).stream() if c.entity_path.endswith("/cloud")]
        drawn = clouds[0].to_record_batch().to_pydict()["Points3D:positions"][0]
        assert len(drawn) == 25_000

    def test_a_killed_session_is_resumed(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"

        def interrupted() -> None:
            with ViewWriter(path, run_id="r") as view:
                for i in range(20):
                    view.add(i, make_scan(i))
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert not path.exists()
        part = tmp_path / ".view.rrd.parts" / "part-0000.rrd"
        whole = part.read_bytes()
        part.write_bytes(whole[: len(whole) * 4 // 5])  # as a kill in the middle of a write
        with ViewWriter(path, run_id="r", resume=True) as view:
            for i in range(16, 24):
                view.add(i, make_scan(i))
            assert "before the run was resumed" in view.close().as_text()
        assert _rrd("verify", path) == 0
        assert _rows_by_entity(path)["/world/lidar_top/top/cloud"] >= 8 + 16
        assert list(tmp_path.iterdir()) == [path]

    def test_frames_need_one_root(self, tmp_path: Path) -> None:
        other = Transform.identity("map", "lidar_left")
        with pytest.raises(GeometryError, match="one root"):
            ViewWriter(tmp_path / "v.rrd", run_id="r", T_root_frames=[self.T_base_lidar, other])

    def test_a_finished_view_is_continued(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        self.write(path, [make_scan(0)])
        with ViewWriter(path, run_id="r", resume=True) as view:
            view.add(1, make_scan(1))
        assert _rows_by_entity(path)["/world/lidar_top/top/cloud"] == 2
        self.write(path, [make_scan(0)])  # without resume it starts anew
        assert _rows_by_entity(path)["/world/lidar_top/top/cloud"] == 1

    def test_parts_that_are_no_view_are_counted(self, make_scan: MakeScan, tmp_path: Path) -> None:
        self.write(tmp_path / "a.rrd", [make_scan(0)])
        (tmp_path / "b.rrd").write_bytes(b"no view at all, but long enough to look into")
        parts = [tmp_path / "a.rrd", tmp_path / "b.rrd"]
        assert merge_views(parts, tmp_path / "out.rrd", run_id="r") == 1
        assert _rows_by_entity(tmp_path / "out.rrd")["/world/lidar_top/top/cloud"] == 1

    def test_open_says_what_is_missing(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with pytest.raises(InputError, match="no such view"):
            open_view(tmp_path / "view.rrd")
        monkeypatch.delenv("DISPLAY", raising=False)
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        (tmp_path / "view.rrd").touch()
        with pytest.raises(DependencyError, match=r"no screen.*`rerun view\.rrd`"):
            open_view(tmp_path / "view.rrd")

    def test_open_listens_on_the_loopback_only(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        commands: list[list[str]] = []

        def run(command: list[str], *, check: bool) -> subprocess.CompletedProcess[str]:
            commands.append(command)
            return subprocess.CompletedProcess(command, int(check))

        monkeypatch.setenv("DISPLAY", ":0")
        monkeypatch.setattr(subprocess, "run", run)
        (tmp_path / "view.rrd").touch()
        open_view(tmp_path / "view.rrd")
        assert commands[0][commands[0].index("--bind") + 1] == "127.0.0.1"
