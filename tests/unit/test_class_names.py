"""Class names: COCO's, and from files."""

from __future__ import annotations

from pathlib import Path

import pytest

from percept.core.errors import InputError
from percept.detection.networks.class_names import coco_names, read_class_names


def test_coco() -> None:
    names = coco_names()
    assert len(set(names)) == 80
    assert (names[0], names[2], names[9], names[79]) == (
        "person", "car", "traffic light", "toothbrush",
    )  # fmt: skip


def test_coco_agrees_with_the_file_of_a_network(shared_data: Path) -> None:
    listed = read_class_names(shared_data / "yolo" / "yolox_nano" / "coco_classes.txt")
    other = {a: b for a, b in zip(coco_names(), listed, strict=True) if a != b}
    # That file has the older spellings of six classes.
    assert sorted(other) == [
        "airplane", "couch", "dining table", "motorcycle", "potted plant", "tv",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.txt", "red\noff\nbus stop\n\n"),
        ("windows.txt", "\ufeffred\r\noff\r\nbus stop"),
        ("list.yaml", "names: [red, off, bus stop]"),
        ("map.yml", "path: x\nnames:\n  0: red\n  1: off\n  2: bus stop\n"),
        ("shuffled.yaml", "names: {2: bus stop, 0: red, 1: off}"),
    ],
)
def test_files(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(text.encode())
    assert read_class_names(path) == ("red", "off", "bus stop")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.txt", b"", "0 class names"),
        ("a.txt", b"car\n\nbus", "class 1 is empty"),
        ("a.txt", b"car\nbus\ncar", "'car' is there 2 times"),
        ("a.txt", b"car\n\x1b[31mred", "class 1 is empty or no plain text"),
        ("a.txt", b"x" * 101, "class 0"),
        ("a.txt", b"\xff\xfe\x00c", "this is no text"),
        ("a.txt", b"c\n" * 600_000, "too large"),
        ("a.yaml", b"classes: [car]", "no 'names'"),
        ("a.yaml", b"[car]", "no 'names'"),
        ("a.yaml", b"names: car", "must be a list"),
        ("a.yaml", b"names: [[a, b]]", "class 0 is empty or no plain text"),
        ("a.yaml", b"names: {0: car, 2: bus}", "run from 0 to 1"),
        ("a.yaml", b"names: {car: 0}", "run from 0 to 0"),
        ("a.yaml", b"names: [car", "this is no YAML"),
        ("a.yaml", b"names: !!python/object/apply:os.system {x: y}", "run from 0 to 0"),
        ("a.yaml", b"[" * 50_000, "YAML"),
    ],
)
def test_files_that_cannot_be_used(name: str, content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_class_names(path)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_class_names(tmp_path / "none.txt")
