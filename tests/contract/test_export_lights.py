"""What a run says of traffic lights: table, messages, lanes and faces in the view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from made_tracks import START_NS, STEP_NS, make_lights, make_trajectory
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import RrdReader

from percept.core.errors import InputError
from percept.export.light_states import LIGHT_COLOURS, shown_state
from percept.export.light_table import LIGHTS, light_rows, read_lights
from percept.export.overlay import OverlayWriter
from percept.export.tables import write_parquet
from percept.export.view import ViewWriter
from percept.hdmap.light import MapLight

_CORNERS = np.array([[50.0, 1, 5], [50, -1, 5], [50, -1, 7], [50, 1, 7]])


class TestTable:
    def write(self, folder: Path, steps: range) -> Path:
        path = folder / "lights.parquet"
        write_parquet(path, LIGHTS, (light_rows(make_lights(step)) for step in steps))
        return path

    def test_gives_back_what_went_in(self, tmp_path: Path) -> None:
        path = self.write(tmp_path, range(40))
        assert ", ".join(pq.read_schema(path).names) == (
            "stamp_ns, light_id, state, flashing, probability, cameras"
        )
        read = list(read_lights(path))
        assert len(read) == 40
        for step, found in enumerate(read):
            given = make_lights(step)
            assert (found.stamp_ns, found.states, found.cameras) == (
                given.stamp_ns, given.states, given.cameras,
            )  # fmt: skip
            for name in ("ids", "flashing", "probabilities"):
                assert np.array_equal(getattr(found, name), getattr(given, name))

    @pytest.mark.parametrize(
        ("column", "values", "said"),
        [
            ("cameras", None, "has no column cameras"),
            ("flashing", pa.array(["no"] * 3), "column flashing is string, not bool"),
            ("state", pa.array(["red", None, "red"]), "column state has empty cells"),
        ],
    )
    def test_what_does_not_fit_is_said(
        self, tmp_path: Path, column: str, values: pa.Array | None, said: str
    ) -> None:
        path = self.write(tmp_path, range(1))
        table = pq.read_table(path).drop_columns(column)
        pq.write_table(table if values is None else table.append_column(column, values), path)
        with pytest.raises(InputError, match=said):
            list(read_lights(path))


class TestShownState:
    def test_dark_and_not_seen_are_kept_apart(self) -> None:
        shown = {shown_state(make_lights(step), row) for step in range(60) for row in range(3)}
        assert shown == {
            "red", "green", "yellow flashing", "unknown flashing", "unknown", "dark", "not seen",
        }  # fmt: skip
        assert shown <= set(LIGHT_COLOURS)

    def test_a_strange_state_is_unknown(self) -> None:
        lights = replace(make_lights(0), states=("violet", "red", "red"))
        assert shown_state(lights, 0) == "unknown"


class TestOverlay:
    def read(self, path: Path) -> dict[str, list[Any]]:
        found: dict[str, list[Any]] = {}
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for _, channel, _, message in reader.iter_decoded_messages():
                found.setdefault(channel.topic, []).append(message)
        return found

    def test_holds_what_each_light_shows(self, tmp_path: Path) -> None:
        path = tmp_path / "overlay.mcap"
        with OverlayWriter(path) as overlay:
            for step in (0, 20):
                overlay.add_lights(
                    make_lights(step), START_NS, faces={502: _CORNERS}, frame_id="map"
                )
        read = self.read(path)
        array = read["/percept/lights"][1]
        assert array.header.frame_id == "map"
        assert [(d.id, d.results[0].hypothesis.class_id) for d in array.detections] == [
            ("501", "red"), ("502", "yellow flashing"), ("777", "not seen"),
        ]  # fmt: skip
        assert array.detections[1].results[0].hypothesis.score == 0.93
        box = array.detections[1].bbox
        assert (box.center.position.x, box.center.position.z, box.size.y) == (50, 6, 2)
        wipe, face = read["/percept/lights/markers"][1].markers
        assert (wipe.action, face.type, len(face.points)) == (3, 11, 12)
        assert face.color.r == pytest.approx(LIGHT_COLOURS["yellow flashing"][0] / 255)

    def test_without_a_map_there_are_no_markers(self, tmp_path: Path) -> None:
        with OverlayWriter(tmp_path / "o.mcap") as overlay:
            overlay.add_lights(make_lights(0), START_NS)
        assert list(self.read(tmp_path / "o.mcap")) == ["/percept/lights"]


class TestView:
    light = MapLight(light_id=501, corners_map=_CORNERS, facing=np.array([-1.0, 0, 0]))

    def rows(self, path: Path, entity: str) -> dict[str, list[Any]]:
        columns: dict[str, list[Any]] = {}
        for chunk in RrdReader(path).stream():
            if chunk.entity_path == entity and not chunk.is_static:
                for name, values in chunk.to_record_batch().to_pydict().items():
                    columns.setdefault(name, []).extend(values)
        return columns

    def test_a_lane_changes_with_its_light(self, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        with ViewWriter(path, run_id="r", frames_expected=0) as view:
            for step in range(100):
                lights = make_lights(step)
                if step >= 90:  # the last one leaves
                    lights = replace(
                        lights, ids=lights.ids[:2], states=lights.states[:2],
                        flashing=lights.flashing[:2], probabilities=lights.probabilities[:2],
                        cameras=lights.cameras[:2],
                    )  # fmt: skip
                view.add_lights(lights)
        lane = self.rows(path, "/states/lights/501")
        assert [state for (state,) in lane["StateChange:state"]] == ["red", "green", "red"]
        stamps = np.array(lane["bag_time"], dtype="datetime64[ns]").astype(np.int64)
        assert (stamps - START_NS).tolist() == [0, 40 * STEP_NS, 60 * STEP_NS]
        last = self.rows(path, "/states/lights/777")["StateChange:state"]
        assert [state for (state,) in last][-3:] == ["dark", "not seen", ""]
        assert not any(c.entity_path.startswith("/world/") for c in RrdReader(path).stream())

    def test_faces_hang_where_the_map_has_them(self, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        with ViewWriter(path, run_id="r", frames_expected=0) as view:
            view.add_poses(make_trajectory())
            for step in range(50):
                view.add_lights(make_lights(step), [self.light])
        outlines = self.rows(path, "/world/map/lights/outlines")
        assert np.allclose(outlines["LineStrips3D:strips"][0][0][:4], _CORNERS)
        assert outlines["LineStrips3D:labels"][0] == ["501 red"]
        faces = self.rows(path, "/world/map/lights/faces")
        assert faces["Mesh3D:triangle_indices"][0] == [[0, 1, 2], [0, 2, 3]]
        changes = len({tuple(shown_state(make_lights(s), r) for r in range(3)) for s in range(50)})
        assert 3 < len(faces["bag_time"]) <= changes + 2  # drawn when something changes alone
