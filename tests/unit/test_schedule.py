"""Which network looks at which image, and how many cores there are for it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from percept.core.errors import UsageError
from percept.detection.cores import available_cores
from percept.detection.schedule import ModelSchedule, parse_model_argument


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("near=small.onnx", ("near", "small.onnx", 1)),
        ("near=small.onnx@every=5", ("near", "small.onnx", 5)),
        ("a.b-c_1=builtin@every=12", ("a.b-c_1", "builtin", 12)),
        ("a=/x y/day=3/net@every.onnx@every=2", ("a", "/x y/day=3/net@every.onnx", 2)),
        ("a=net@v2.onnx", ("a", "net@v2.onnx", 1)),
    ],
)
def test_model_arguments(text: str, expected: tuple[str, str, int]) -> None:
    assert parse_model_argument(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("small.onnx", "is not of the form NAME=FILE.onnx"),
        ("=small.onnx", "is not of the form"),
        ("a=", "is not of the form"),
        ("", "is not of the form"),
        ("a/b=small.onnx", "is not of the form"),
        ("-a=small.onnx", "is not of the form"),
        ("a=@every=3", "is not of the form"),
        ("a=s.onnx@every=0", "says every=0"),
        ("a=s.onnx@every=", "says every=,"),
        ("a=s.onnx@every=-1", "says every=-1"),
        ("a=s.onnx@every=1.5", "says every=1.5"),
        ("a=s.onnx@every=²", "says every=²"),
        ("a=s.onnx@every=2@every=3", "says every=2@every=3"),
    ],
)
def test_model_arguments_that_cannot_be_read(text: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_model_argument(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_each_model_has_its_own_rate() -> None:
    schedule = ModelSchedule({"far": 5, "near": 1, "lights": 2})
    assert schedule.models_at(0) == ("far", "near", "lights")
    assert schedule.models_at(1) == ("near",)
    assert schedule.models_at(4) == ("near", "lights")
    assert [k for k in range(12) if "far" in schedule.models_at(k)] == [0, 5, 10]


def test_a_camera_may_have_images_that_nobody_looks_at() -> None:
    assert ModelSchedule({"far": 3}).models_at(1) == ()


@pytest.fixture
def eight_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)


@pytest.mark.usefixtures("eight_cores")
class TestCores:
    @pytest.mark.parametrize(
        ("group", "files", "cores"),
        [
            ("0::/", {}, 8),
            ("0::/", {"cpu.max": "max 100000"}, 8),
            ("0::/", {"cpu.max": "200000 100000"}, 2),
            ("0::/", {"cpu.max": "150000 100000"}, 2),
            ("0::/", {"cpu.max": "20000 100000"}, 1),
            ("0::/", {"cpu.max": "6400000 100000"}, 8),
            ("0::/", {"cpu.max": "what is this"}, 8),
            # The quota of a group above counts too, and the smallest wins.
            ("0::/a/b", {"a/b/cpu.max": "max 100000", "a/cpu.max": "300000 100000"}, 3),
            ("0::/a/b", {"a/b/cpu.max": "100000 50000", "a/cpu.max": "300000 100000"}, 2),
            # In a container the group is the root, but the path may be that of the host.
            ("0::/docker/1234", {"cpu.max": "400000 100000"}, 4),
            ("4:cpu:/", {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, 8),
            (
                "4:cpu,cpuacct:/a",
                {
                    "cpu,cpuacct/a/cpu.cfs_quota_us": "250000",
                    "cpu,cpuacct/a/cpu.cfs_period_us": "100000",
                },
                3,
            ),
            ("4:cpuset:/", {"cpuset/cpu.cfs_quota_us": "1", "cpuset/cpu.cfs_period_us": "1"}, 8),
        ],
    )
    def test_quotas_of_containers(
        self, tmp_path: Path, group: str, files: dict[str, str], cores: int
    ) -> None:
        for name, text in files.items():
            file = tmp_path / "mounts" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text + "\n")
        (tmp_path / "groups").write_text(f"9:name=systemd:/\n{group}\n")
        assert available_cores(tmp_path / "groups", tmp_path / "mounts") == cores

    def test_without_control_groups_the_affinity_counts(self, tmp_path: Path) -> None:
        assert available_cores(tmp_path / "none", tmp_path) == 8


def test_never_more_than_the_machine_has() -> None:
    assert 1 <= available_cores() <= (os.cpu_count() or 1)
