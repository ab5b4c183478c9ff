"""Inspection of logs that are made for it: every figure has a truth to be compared with."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pytest

from percept.core.errors import ConfigError, RecordingError
from percept.core.results import Verdict
from percept.core.samples import (
    CameraImage,
    CameraInfo,
    GnssFix,
    ImuSample,
    OtherSample,
    PointCloud,
    Sample,
    TransformSample,
)
from percept.core.settings import load_settings
from percept.core.transform import Transform
from percept.datasets.inspection import InspectConfig, Inspection, inspect_recording
from percept.datasets.inspection.clock import ClockWatch
from percept.datasets.inspection.intervals import IntervalHistogram
from percept.datasets.inspection.sensors import implausible_intrinsics, info_topic_of
from percept.datasets.inspection.topics import TopicReport
from percept.datasets.recording import Envelope, TopicInfo, UndecodedMessage

_S = 1_000_000_000
_EPOCH = 1_700_000_000 * _S


@dataclass
class _Message:
    sample: Sample
    header: bool = True


class _FakeRecording:
    """Messages in memory, behind the protocol that the real readers obey."""

    def __init__(
        self,
        messages: Iterable[_Message] = (),
        declared: Iterable[TopicInfo] = (),
        losses: dict[str, int] | None = None,
    ) -> None:
        self._messages = sorted(messages, key=lambda m: m.sample.log_time_ns)
        self._declared = tuple(declared)
        self.paths: tuple[Path, ...] = (Path("fake.mcap"),)
        self.format = "mcap"
        self.losses = Counter(losses or {})
        self.notes: tuple[str, ...] = ()
        times = [m.sample.log_time_ns for m in self._messages]
        self.start_ns = min(times, default=None)
        self.end_ns = max(times, default=None)

    def topics(self) -> tuple[TopicInfo, ...]:
        counts = Counter(m.sample.topic for m in self._messages)
        types = {m.sample.topic: type(m.sample) for m in self._messages}
        found = [TopicInfo(t, f"x/msg/{types[t].__name__}", counts[t], types[t]) for t in counts]
        known = {info.topic for info in self._declared}
        kept = (*self._declared, *(info for info in found if info.topic not in known))
        return tuple(sorted(kept, key=lambda info: info.topic))

    def samples(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Sample]:
        broken = {info.topic for info in self._declared}
        for message in self._messages:
            sample = message.sample
            wanted = topics is None or sample.topic in topics
            late = start_ns is not None and sample.log_time_ns < start_ns
            if not wanted or late or (end_ns is not None and sample.log_time_ns > end_ns):
                continue
            if sample.topic in broken:
                self.losses["broken payload"] += 1
            else:
                yield sample

    def undecoded(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[UndecodedMessage]:
        raise NotImplementedError

    def envelopes(self, *, topics: Collection[str] | None = None) -> Iterator[Envelope]:
        for message in self._messages:
            sample = message.sample
            if topics is None or sample.topic in topics:
                stamp_ns = sample.stamp_ns if message.header else None
                yield Envelope(sample.topic, stamp_ns, sample.log_time_ns, 100)

    def close(self) -> None:
        pass

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


_CLOUD = np.array([[10, 0, 0], [0, 10, 1], [-5, -5, -1]], dtype=np.float32)


def _clouds(
    topic: str = "/lidar",
    stamps_s: Iterable[float] = (),
    delays_s: Iterable[float] | None = None,
    **fields: Any,
) -> list[_Message]:
    stamps = list(stamps_s)
    delays = [0.02] * len(stamps) if delays_s is None else list(delays_s)
    return [
        _Message(
            PointCloud(
                topic=topic,
                stamp_ns=_EPOCH + round(stamp * _S),
                log_time_ns=_EPOCH + round((stamp + delay) * _S),
                frame="lidar",
                points_xyz=_CLOUD,
                **fields,
            )
        )
        for stamp, delay in zip(stamps, delays, strict=True)
    ]


def _steady(count: int = 100, rate_hz: float = 10.0) -> list[float]:
    return [i / rate_hz for i in range(count)]


def _edge(parent: str, child: str, *, static: bool = True, at_s: float = 0.0) -> _Message:
    at_ns = _EPOCH + round(at_s * _S)
    return _Message(
        TransformSample(
            topic="/tf_static" if static else "/tf",
            stamp_ns=at_ns,
            log_time_ns=at_ns,
            frame=parent,
            T_frame_child=Transform.identity(parent, child),
            static=static,
        )
    )


def _inspect(messages: Iterable[_Message], **config: Any) -> Inspection:
    return inspect_recording(_FakeRecording(messages), InspectConfig(**config))


def _topic(inspection: Inspection, name: str = "/lidar") -> TopicReport:
    return next(topic for topic in inspection.topics if topic.topic == name)


def test_a_steady_stream_is_good_and_its_figures_are_exact() -> None:
    inspection = _inspect(_clouds(stamps_s=_steady()))
    topic = _topic(inspection)
    assert (inspection.verdict, inspection.why) == (Verdict.GOOD, ())
    assert (topic.count, topic.bytes, inspection.messages) == (100, 10_000, 100)
    assert topic.timing.rate_hz == pytest.approx(10)
    assert topic.timing.jitter_s == 0
    assert topic.timing.clock == "header"
    assert (topic.timing.gap_count, topic.timing.dropped_estimate) == (0, 0)
    assert topic.clock is not None
    assert topic.clock.offset_s == pytest.approx(0.02)
    assert topic.lateness is not None
    assert topic.lateness.late_share == 0
    assert inspection.duration_s == pytest.approx(9.9)


def test_gaps_are_found_with_their_place_and_what_they_lost() -> None:
    stamps = [s for s in _steady() if not (3.05 < s < 3.55 or 7.05 < s < 7.25)]
    timing = _topic(_inspect(_clouds(stamps_s=stamps))).timing
    assert timing.gap_count == 2
    assert timing.dropped_estimate == 5 + 2
    assert [round(gap.length_s, 6) for gap in timing.gaps] == [0.6, 0.3]
    assert [gap.dropped for gap in timing.gaps] == [5, 2]
    assert timing.gaps[0].start_ns == _EPOCH + round(3.02 * _S)


def test_one_late_interval_below_the_limit_is_no_gap() -> None:
    stamps = [s for s in _steady() if not 3.05 < s < 3.15]
    timing = _topic(_inspect(_clouds(stamps_s=stamps))).timing
    assert (timing.gap_count, timing.dropped_estimate) == (0, 0)


def test_the_watchdog_agrees_with_a_monitor_that_runs_along() -> None:
    rng = np.random.default_rng(3)
    stamps = np.cumsum(rng.choice([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5, 1.7], 300)) + 2.0
    beacon = _clouds("/beacon", np.arange(0, stamps[-1] + 4, 0.05), intensity=None)
    inspection = _inspect([*_clouds(stamps_s=stamps), *beacon])
    late = _topic(inspection).lateness
    assert late is not None
    assert inspection.end_ns is not None
    ticks = np.arange(0.02, (inspection.end_ns - _EPOCH) / _S, 0.001)
    arrivals = np.concatenate([[0.02], stamps + 0.02])
    silence = ticks - arrivals[np.searchsorted(arrivals, ticks, side="right") - 1]
    is_late = silence > late.timeout_s
    assert late.timeout_s == pytest.approx(0.3)
    assert late.late_share == pytest.approx(is_late.mean(), abs=2e-3)
    assert late.late_spans == np.count_nonzero(np.diff(is_late.astype(int)) == 1)
    assert late.longest_s == pytest.approx(silence.max() - late.timeout_s, abs=2e-3)
    assert late.longest_start_ns == _EPOCH + round(arrivals[-1] * _S)


def test_a_given_rate_decides_instead_of_the_median() -> None:
    inspection = _inspect(_clouds(stamps_s=_steady(50, 2.0)), rates_hz={"/lidar": 10})
    late = _topic(inspection).lateness
    assert late is not None
    assert late.nominal_s == pytest.approx(0.1)
    assert late.late_share == pytest.approx((0.5 - 0.3) / 0.5)
    assert inspection.verdict is not Verdict.GOOD


def test_a_topic_that_was_expected_and_is_absent_makes_the_log_bad() -> None:
    inspection = _inspect(_clouds(stamps_s=_steady()), rates_hz={"/lidar_left": 10})
    assert inspection.verdict is Verdict.BAD
    assert inspection.why == ("expected but not in the log: /lidar_left",)


def test_events_are_not_blamed_for_having_no_rhythm() -> None:
    rng = np.random.default_rng(1)
    stamps = np.cumsum(rng.exponential(1.0, 200))
    event = [
        _Message(
            OtherSample(
                topic="/rosout",
                stamp_ns=_EPOCH + int(t * _S),
                log_time_ns=_EPOCH + int(t * _S),
                msgtype="x/msg/Log",
                message=None,
            ),
            header=False,
        )
        for t in stamps
    ]
    inspection = _inspect(event)
    topic = _topic(inspection, "/rosout")
    assert not topic.timing.periodic
    assert topic.lateness is None
    assert (topic.timing.clock, topic.clock) == ("log", None)
    assert inspection.verdict is Verdict.GOOD


@pytest.mark.parametrize("drift_ppm", [-350.0, 0.0, 40.0])
def test_drift_and_jumps_come_back_through_noisy_delays(drift_ppm: float) -> None:
    rng = np.random.default_rng(5)
    watch = ClockWatch(0.1)
    for log_s in np.arange(0, 120, 0.05):
        gain_s = drift_ppm * 1e-6 * log_s + (1.5 if log_s > 60 else 0)
        delay_s = 0.01 + rng.exponential(0.004)
        log_ns = _EPOCH + round(log_s * _S)
        watch.add(log_ns, log_ns + round((gain_s - delay_s) * _S))
    health = watch.result()
    assert health is not None
    assert health.drift_ppm == pytest.approx(drift_ppm, abs=5)
    assert health.drift_sd_ppm is not None
    assert health.drift_ppm is not None
    assert abs(health.drift_ppm - drift_ppm) < 4 * health.drift_sd_ppm
    assert health.jump_count == 1
    assert health.jumps[0].step_s == pytest.approx(1.5, abs=2e-3)
    assert health.jumps[0].log_time_ns == pytest.approx(_EPOCH + 60 * _S, abs=2 * _S)


def test_a_drift_is_not_claimed_from_a_few_seconds() -> None:
    topic = _topic(_inspect(_clouds(stamps_s=_steady(50))))
    assert topic.clock is not None
    assert topic.clock.drift_ppm is None


def test_a_clock_that_is_off_is_named_with_its_size() -> None:
    messages = _clouds(stamps_s=_steady(), delays_s=[-37.0] * 100)
    inspection = _inspect(messages)
    assert inspection.verdict is Verdict.DOUBTFUL
    assert inspection.why == (
        "header clock is off the log clock: /lidar (37.0 s ahead, TAI against UTC?)",
    )


def test_order_duplicates_and_zero_stamps_are_counted() -> None:
    stamps = _steady(40)
    stamps[10], stamps[11] = stamps[11], stamps[10]
    stamps[20] = stamps[19]
    log_s = _steady(40)
    messages = _clouds(
        stamps_s=stamps, delays_s=[t - s for s, t in zip(stamps, log_s, strict=True)]
    )
    object.__setattr__(messages[30].sample, "stamp_ns", 0)
    inspection = _inspect(messages)
    order = _topic(inspection).order
    assert (order.header_disorder, order.duplicate_stamps, order.zero_stamps) == (1, 1, 1)
    assert order.log_disorder == 0
    assert inspection.verdict is Verdict.DOUBTFUL
    assert _topic(inspection).timing.clock == "log"


def test_a_damaged_log_is_doubtful_and_an_unreadable_one_is_refused() -> None:
    damaged = _FakeRecording(_clouds(stamps_s=_steady()), losses={"the end is cut off": 1})
    inspection = inspect_recording(damaged)
    assert inspection.verdict is Verdict.DOUBTFUL
    assert inspection.why == ("lost: the end is cut off (1)",)
    with pytest.raises(RecordingError, match=r"fake\.mcap: nothing in it can be read \(no chunk"):
        inspect_recording(_FakeRecording(losses={"no chunk is whole": 3}))


def test_a_sound_log_without_messages_is_bad() -> None:
    inspection = inspect_recording(_FakeRecording(declared=[TopicInfo("/a", "t", 0, PointCloud)]))
    assert (inspection.verdict, inspection.messages) == (Verdict.BAD, 0)
    assert inspection.verdict.exit_code == 4
    assert inspection.start_ns is None


def test_streams_that_do_not_decode_are_named_and_not_used() -> None:
    broken = TopicInfo("/lidar", "sensor_msgs/msg/PointCloud2", 100, PointCloud)
    inspection = inspect_recording(_FakeRecording(_clouds(stamps_s=_steady()), declared=[broken]))
    assert _topic(inspection).undecodable == "broken payload"
    assert inspection.verdict is Verdict.BAD
    assert inspection.why[0] == "no sensor stream in it can be used"
    assert not any(use.usable for use in inspection.uses)
    assert inspection.losses == {}


def test_one_dead_sensor_beside_a_live_one_is_doubtful() -> None:
    dead = TopicInfo("/camera", "sensor_msgs/msg/Image", 0, CameraImage)
    log = _FakeRecording(_clouds(stamps_s=_steady()), declared=[dead])
    inspection = inspect_recording(log)
    assert inspection.verdict is Verdict.DOUBTFUL
    assert inspection.why == ("without messages: /camera",)


def _full_log() -> list[_Message]:
    def at(i: int) -> dict[str, Any]:
        return {"stamp_ns": _EPOCH + i * _S // 10, "log_time_ns": _EPOCH + i * _S // 10}

    pixels = np.zeros((480, 640, 3), np.uint8)
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    info: dict[str, Any] = {
        "image_size": (640, 480),
        "model": "plumb_bob",
        "K": K,
        "distortion": np.zeros(5),
    }
    messages: list[_Message] = [_edge("base_link", "lidar"), _edge("base_link", "left")]
    for i in range(50):
        samples = [
            CameraImage(
                topic="/cam/image_raw", frame="cam", pixels=pixels, encoding="rgb8", **at(i)
            ),
            CameraInfo(topic="/cam/camera_info", frame="cam", **info, **at(i)),
            GnssFix(topic="/fix", latitude_deg=48.0, longitude_deg=9.0, altitude_m=300.0, **at(i)),
            ImuSample(
                topic="/imu",
                angular_velocity_radps=np.zeros(3),
                linear_acceleration_mps2=np.array([0, 0, 9.8]),
                **at(i),
            ),
        ]
        messages += [_Message(sample) for sample in samples]
    columns = {
        "intensity": np.array([1, 2, 9]),
        "ring": np.array([0, 0, 4]),
        "offset_ns": np.array([0, 1, 100_000_000]),
    }
    messages += _clouds("/lidar", _steady(50), [0.0] * 50, **columns)
    return messages + _clouds("/left", _steady(50), [0.0] * 50)


def test_sensors_are_described_and_jobs_follow() -> None:
    inspection = _inspect(_full_log())
    assert inspection.verdict is Verdict.GOOD
    uses = {use.job: use for use in inspection.uses}
    assert all(use.usable for use in uses.values()), uses
    assert "position from /fix" in uses["map validate"].why
    assert "some without intensity" in uses["detect (LiDAR)"].why
    described = inspection.to_dict()["topics"]
    by_topic = {entry["topic"]: entry["sensor"] for entry in described}
    lidar = by_topic["/lidar"]
    assert (lidar["points"], lidar["rings"], lidar["intensity"]) == (3, 2, (1.0, 9.0))
    assert lidar["scan_s"] == pytest.approx(0.1)
    assert lidar["range_m"][1] == pytest.approx(10.05, abs=0.05)
    assert by_topic["/left"]["intensity"] is None
    camera = by_topic["/cam/image_raw"]
    assert (camera["width_px"], camera["height_px"]) == (640, 480)
    assert (camera["info_topic"], camera["info_problem"]) == ("/cam/camera_info", None)
    assert by_topic["/imu"]["problem"] is None
    assert by_topic["/fix"]["fix_share"] == 1


def test_jobs_say_what_is_missing() -> None:
    uses = {use.job: use for use in _inspect(_clouds(stamps_s=_steady(5))).uses}
    usable = [job for job, use in uses.items() if use.usable]
    assert usable == ["detect (LiDAR)"]
    assert uses["calib lidar"].why == "needs two LiDARs, the log has 1"
    assert uses["odometry"].why == "needs 10 scans, the log has 5"
    assert "images" in uses["calib camera-lidar"].why


def test_the_whole_report_is_json() -> None:
    plain = _inspect(_full_log()).to_dict()
    again = json.loads(json.dumps(plain, allow_nan=False))
    assert again["verdict"] == "good"
    assert {t["topic"]: t["count"] for t in again["topics"]}["/fix"] == 50
    assert again["messages"] == sum(t["count"] for t in again["topics"])
    assert again["frames"]["missing"] == {"cam": ["/cam/image_raw"]}


def test_values_that_are_not_finite_do_not_reach_the_report() -> None:
    stamps = _steady(10)
    nowhere = np.full((3, 3), np.nan)
    fixes = [
        _Message(
            GnssFix(
                topic="/fix",
                stamp_ns=_EPOCH + int(s * _S),
                log_time_ns=_EPOCH + int(s * _S),
                latitude_deg=float("nan"),
                longitude_deg=9.0,
                altitude_m=0.0,
                covariance_m2=nowhere,
            )
        )
        for s in stamps
    ]
    clouds = _clouds(stamps_s=stamps, intensity=np.array([np.nan, 3, np.inf]))
    inspection = _inspect([*fixes, *clouds])
    plain = json.loads(json.dumps(inspection.to_dict(), allow_nan=False))
    sensors = {topic["topic"]: topic["sensor"] for topic in plain["topics"]}
    assert sensors["/lidar"]["intensity"] == [3, 3]
    assert (sensors["/fix"]["fix_share"], sensors["/fix"]["latitude_deg"]) == (0, None)
    assert "without a fix: /fix" in inspection.why


def test_scans_without_a_point_are_bad() -> None:
    empty = _clouds(stamps_s=_steady())
    for message in empty:
        object.__setattr__(message.sample, "points_xyz", np.empty((0, 3), np.float32))
    inspection = _inspect(empty)
    assert inspection.verdict is Verdict.BAD
    assert "scans without a finite point: /lidar" in inspection.why
    assert not any(use.usable for use in inspection.uses)


def test_frames_are_drawn_and_contradictions_are_doubtful() -> None:
    messages = _clouds(stamps_s=_steady())
    sound = _inspect([*messages, _edge("base_link", "lidar")])
    assert sound.verdict is Verdict.GOOD
    assert sound.frames.tree.splitlines() == ["base_link", "└─ lidar (static)"]
    two = _inspect([*messages, _edge("base_link", "lidar"), _edge("roof", "lidar", at_s=1)])
    assert two.verdict is Verdict.DOUBTFUL
    assert "two parents" in two.why[0]
    cycle = _inspect([*messages, _edge("a", "b"), _edge("b", "a", at_s=1)])
    assert cycle.why == ("frames a, b form a cycle",)


def test_frames_that_tf_does_not_know_are_noted() -> None:
    messages = _clouds(stamps_s=_steady())
    assert _inspect(messages).frames.missing == {"lidar": ("/lidar",)}
    noted = _inspect([*messages, _edge("base_link", "camera"), _edge("map", "odom", static=False)])
    assert noted.verdict is Verdict.GOOD
    assert any("lidar (/lidar)" in note for note in noted.notes)
    assert any("2 trees" in note for note in noted.notes)


def test_a_part_of_a_log_is_looked_at_alone() -> None:
    recording = _FakeRecording(_clouds(stamps_s=_steady()))
    part = inspect_recording(recording, start_ns=_EPOCH + 2 * _S, end_ns=_EPOCH + 4 * _S)
    assert part.messages == 20
    assert part.duration_s == pytest.approx(1.9)
    damaged = _FakeRecording(_clouds(stamps_s=_steady()), losses={"the end is cut off": 1})
    beyond = inspect_recording(damaged, start_ns=_EPOCH + 20 * _S)
    assert (beyond.verdict, beyond.messages) == (Verdict.BAD, 0)


def test_progress_counts_messages() -> None:
    seen: list[int] = []
    inspect_recording(_FakeRecording(_clouds(stamps_s=_steady(2500))), on_progress=seen.append)
    assert seen == [0, 1000, 2000]


def test_interval_quantiles_and_sums_match_numpy() -> None:
    rng = np.random.default_rng(0)
    lengths = (rng.lognormal(17, 1.5, 20_000)).astype(np.int64) + 1
    histogram = IntervalHistogram()
    for index, length in enumerate(lengths):
        histogram.add(int(length), index)
    for share in (0.16, 0.5, 0.84):
        expected = np.quantile(lengths, share)
        assert histogram.quantile_ns(share) == pytest.approx(expected, rel=0.012)
    limit = float(np.quantile(lengths, 0.9))
    above = lengths[lengths > limit]
    assert sum(c * m for c, m in histogram.above(limit)) == pytest.approx(above.sum(), rel=0.02)
    expected_longest = np.sort(lengths)[::-1][:20]
    assert [length for length, _ in histogram.longest(limit)] == expected_longest.tolist()
    assert lengths[histogram.longest(limit)[0][1]] == lengths.max()


def test_memory_does_not_grow_with_the_log() -> None:
    rng = np.random.default_rng(0)
    histogram, clock = IntervalHistogram(), ClockWatch(0.1)
    for index, length in enumerate(rng.lognormal(15, 2, 60_000).astype(np.int64)):
        histogram.add(int(length), index)
        clock.add(index * _S // 100, index * _S // 100 - int(length))
    assert len(histogram._bins) < 3000
    assert len(clock._offsets._values) <= 4096
    assert len(clock._jumps) <= 20


@pytest.mark.parametrize(
    ("image", "infos", "expected"),
    [
        ("/cam/image_raw", ["/cam/camera_info", "/other/camera_info"], "/cam/camera_info"),
        ("/cam/image_raw/compressed", ["/cam/camera_info"], "/cam/camera_info"),
        ("/cam/image", ["/other/camera_info"], None),
        ("/rig/cam/image", ["/rig/camera_info", "/rig/cam/camera_info"], "/rig/cam/camera_info"),
    ],
)
def test_camera_info_is_found_beside_its_images(
    image: str, infos: list[str], expected: str | None
) -> None:
    assert info_topic_of(image, infos) == expected


@pytest.mark.parametrize(
    ("K", "size", "expected"),
    [
        ((500, 500, 320, 240), (640, 480), None),
        ((0, 0, 0, 0), (640, 480), "not calibrated (focal length 0)"),
        ((500, 500, 320, 240), (1280, 960), "for 1280x960 images"),
        ((500, 500, 900, 240), (640, 480), "principal point (900, 240) is outside the image"),
        ((500, 100, 320, 240), (640, 480), "fx / fy is 5.00"),
        ((5, 5, 320, 240), (640, 480), "focal length 5 px for a width of 640 px"),
        ((float("nan"), 500, 320, 240), (640, 480), "not finite"),
    ],
)
def test_intrinsics_that_cannot_be_right_are_named(
    K: tuple[float, float, float, float], size: tuple[int, int], expected: str | None
) -> None:
    fx, fy, cx, cy = K
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    info = CameraInfo(
        topic="/c",
        stamp_ns=0,
        log_time_ns=0,
        image_size=size,
        model="plumb_bob",
        K=matrix,
        distortion=np.zeros(5),
    )
    assert implausible_intrinsics(info, (640, 480)) == expected


def test_an_imu_in_g_is_noticed() -> None:
    readings = [
        _Message(
            ImuSample(
                topic="/imu",
                stamp_ns=_EPOCH + i * _S // 100,
                log_time_ns=_EPOCH + i * _S // 100,
                angular_velocity_radps=np.zeros(3),
                linear_acceleration_mps2=np.array([0, 0, 1.0]),
            )
        )
        for i in range(200)
    ]
    inspection = _inspect(readings)
    assert inspection.verdict is Verdict.DOUBTFUL
    assert "acceleration is in g" in inspection.why[0]


def test_an_unknown_limit_names_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text("late_interval: 4\n")
    with pytest.raises(ConfigError, match="late_intervals"):
        load_settings(InspectConfig, path)
