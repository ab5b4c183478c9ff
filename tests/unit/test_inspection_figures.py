"""Figures of an inspection that can be worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from percept.core.clock import NS_PER_S
from percept.core.results import Verdict
from percept.core.samples import GnssFix, ImuSample, PointCloud
from percept.datasets import open_recording
from percept.datasets.inspection import InspectConfig, inspect_recording
from percept.datasets.inspection.clock import ClockHealth
from percept.datasets.inspection.sensors import GnssSummary, LidarSummary, summarize
from percept.datasets.inspection.timing import StreamOrder, StreamTiming, StreamWatch
from percept.datasets.inspection.topics import TopicReport
from percept.datasets.inspection.verdict import judge_topic
from percept.datasets.inspection.watchdog import lateness_of
from percept.datasets.recording import Envelope
from percept.datasets.write import LogWriter

_START_NS = 1_700_000_000 * NS_PER_S
_SOUND = TopicReport(
    topic="/top",
    type="sensor_msgs/msg/PointCloud2",
    kind="lidar",
    frame="top",
    count=100,
    bytes=100,
    first_ns=_START_NS,
    last_ns=_START_NS + 10 * NS_PER_S,
    timing=StreamTiming(
        clock="header",
        rate_hz=10.0,
        median_interval_s=0.1,
        jitter_s=0.0,
        periodic=True,
        gap_count=0,
        gaps=(),
        dropped_estimate=0,
    ),
    clock=None,
    order=StreamOrder(0, 0, 0, 0),
    lateness=None,
    sensor=None,
    undecodable=None,
    decoding_losses=(),
)
_CLOCK = ClockHealth(
    offset_s=0.0, spread_s=0.0, drift_ppm=None, drift_sd_ppm=None, jumps=(), jump_count=0
)


def test_a_lidar_is_described_by_angles_ranges_and_its_own_times() -> None:
    cloud = PointCloud(
        topic="/top",
        stamp_ns=0,
        log_time_ns=0,
        points_xyz=np.array([[3.0, 0.0, 3.0], [0.0, 4.0, 0.0]], np.float32),
        offset_ns=np.array([-60_000_000, 40_000_000]),
    )
    found = summarize([cloud])
    assert isinstance(found, LidarSummary)
    assert found.elevation_deg == pytest.approx((0.45, 44.55), abs=1e-4)
    assert found.range_m is not None
    assert found.range_m[0] == pytest.approx((4.0 + np.hypot(3.0, 3.0)) / 2, abs=1e-5)
    assert found.azimuth_deg == 2
    assert found.scan_s == pytest.approx(0.1)


def test_the_spread_of_a_fix_is_that_of_one_horizontal_axis() -> None:
    fix = GnssFix(
        topic="/fix", stamp_ns=0, log_time_ns=0, latitude_deg=48.0, longitude_deg=9.0,
        altitude_m=300.0, covariance_m2=np.diag([4.0, 14.0, 100.0]),
    )  # fmt: skip
    found = summarize([fix])
    assert isinstance(found, GnssSummary)
    assert found.horizontal_sd_m == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("offset_s", "text"),
    [(2.0, "2.0 s behind"), (-2.0, "2.0 s ahead"), (-18.0, "18.0 s ahead, GPS time against UTC?")],
)
def test_a_header_clock_that_shows_earlier_times_is_behind(offset_s: float, text: str) -> None:
    judged = judge_topic(replace(_SOUND, clock=replace(_CLOCK, offset_s=offset_s)), InspectConfig())
    assert judged.verdict == Verdict.DOUBTFUL
    assert judged.why == (f"header clock is off the log clock ({text})",)


def test_a_drift_counts_only_where_it_is_beyond_its_own_uncertainty() -> None:
    config = InspectConfig(max_drift_ppm=100.0)
    for sd_ppm, verdict in ((20.0, Verdict.GOOD), (10.0, Verdict.DOUBTFUL)):
        for drift_ppm in (-140.0, 140.0):
            clock = replace(_CLOCK, drift_ppm=drift_ppm, drift_sd_ppm=sd_ppm)
            assert judge_topic(replace(_SOUND, clock=clock), config).verdict == verdict


def test_silence_before_the_first_message_begins_with_the_log() -> None:
    watch = StreamWatch(InspectConfig(), "lidar")
    for tenth in range(50, 100):
        watch.add(Envelope("/top", None, _START_NS + tenth * NS_PER_S // 10, 1))
    late = lateness_of(watch, 0.1, (_START_NS, _START_NS + 10 * NS_PER_S), InspectConfig())
    assert late.longest_start_ns == _START_NS
    assert late.longest_s == pytest.approx(5.0 - late.timeout_s)
    assert late.late_spans == 1


def test_both_ends_of_the_part_that_is_looked_at_belong_to_it(tmp_path: Path) -> None:
    stamps_ns = [_START_NS + second * NS_PER_S for second in range(5)]
    with LogWriter(tmp_path / "log.mcap", "mcap") as writer:
        for stamp_ns in stamps_ns:
            writer.write(
                ImuSample(
                    topic="/imu",
                    stamp_ns=stamp_ns,
                    log_time_ns=stamp_ns,
                    angular_velocity_radps=np.zeros(3),
                    linear_acceleration_mps2=np.array([0.0, 0.0, 9.81]),
                )
            )
    with open_recording(tmp_path / "log.mcap") as recording:
        found = inspect_recording(recording, start_ns=stamps_ns[1], end_ns=stamps_ns[3])
    assert (found.messages, found.start_ns, found.end_ns) == (3, stamps_ns[1], stamps_ns[3])
