"""Classes by rules: typical objects, partial views, reflectance, ambiguity, and rules files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from percept.core.errors import ConfigError
from percept.lidar.classify import (
    UNKNOWN,
    Classification,
    ClusterFeatures,
    Rules,
    classify_clusters,
    load_rules,
)

_RULES = load_rules()


def _classify(
    *rows: tuple[float, float, float, float, float, float], rules: Rules = _RULES
) -> Classification:
    """Judge solid clusters, given as rows of length, width, height, clearance, fill and rho."""
    names = ("length_m", "width_m", "height_m", "clearance_m", "fill", "rho")
    columns = np.array(rows, dtype=np.float64).reshape(-1, 6).T
    features = dict(zip(names, columns, strict=True))
    return classify_clusters(ClusterFeatures(**features, surface=np.ones(len(rows))), rules)


@pytest.mark.parametrize(
    ("label", "row"),
    [
        ("car", (4.5, 1.8, 1.5, 0.2, 0.5, 0.2)),
        ("car", (4.4, 0.8, 1.45, 0.2, 0.6, 0.2)),
        ("car", (1.8, 0.9, 1.3, 0.3, 0.6, 0.1)),
        ("truck", (8.0, 2.5, 3.2, 0.4, 0.4, 0.2)),
        ("cyclist", (1.7, 0.5, 1.75, 0.2, 0.4, 0.2)),
        ("pedestrian", (0.6, 0.4, 1.75, 0.2, 0.5, 0.2)),
        ("deer", (1.6, 0.4, 1.35, 0.3, 0.4, 0.2)),
        ("barrel", (0.55, 0.4, 1.0, 0.2, 0.7, 0.8)),
        ("barricade", (1.5, 0.1, 1.4, 0.2, 0.6, 0.8)),
        ("cone", (0.25, 0.2, 0.7, 0.2, 0.6, 0.6)),
        ("sign", (0.7, 0.1, 2.5, 1.7, 0.5, 0.9)),
        ("sign", (0.7, 0.1, 2.5, 0.2, 0.3, 0.8)),
        (UNKNOWN, (0.2, 0.2, 5.0, 0.2, 0.5, 0.2)),
        (UNKNOWN, (20.0, 0.5, 6.0, 0.2, 0.8, 0.2)),
        (UNKNOWN, (2.0, 1.8, 0.4, 0.2, 0.4, 0.2)),
    ],
)
def test_typical_objects(label: str, row: tuple[float, float, float, float, float, float]) -> None:
    result = _classify(row)
    assert result.labels == (label,)
    assert result.confidences[0] >= 0.35


def test_all_classes_of_the_report_are_there() -> None:
    assert set(_RULES.labels) == {
        "barrel", "barricade", "sign", "pedestrian", "deer", "car", "truck", "cyclist", "cone",
    }  # fmt: skip


def test_reflectance_lifts_retro_reflective_classes_only() -> None:
    nan = float("nan")
    barrel = [_classify((0.55, 0.4, 1.0, 0.2, 0.7, rho)) for rho in (nan, 0.1, 0.5, 0.9)]
    values = [float(result.confidences[0]) for result in barrel]
    assert {result.labels[0] for result in barrel} == {"barrel"}
    assert values[0] == values[1] < values[2] < values[3]
    car = [_classify((4.5, 1.8, 1.5, 0.2, 0.5, rho)).confidences[0] for rho in (nan, 0.1, 0.5)]
    assert len(set(map(float, car))) == 1
    assert _classify((4.5, 1.8, 1.5, 0.2, 0.5, 1.0)).labels == (UNKNOWN,)
    pole = (0.5, 0.1, 2.5, 0.2, 0.3)
    assert _classify((*pole, nan)).labels == (UNKNOWN,)
    assert _classify((*pole, 0.9)).labels == ("sign",)


def test_a_bush_of_the_size_of_a_car_is_no_car() -> None:
    same = (np.full(3, value) for value in (4.3, 1.8, 1.5, 0.2, 0.5, 0.2))
    length, width, height, clearance, fill, rho = same
    surface = np.array([0.6, 0.3, 0.1])
    features = ClusterFeatures(length, width, height, clearance, fill, surface, rho)
    result = classify_clusters(features, _RULES)
    assert result.labels == ("car", "car", UNKNOWN)


def test_ambiguity_lowers_confidence() -> None:
    twins = {
        "classes": {
            name: {
                "shapes": {
                    "any": {"length_m": [0, 1, 2, 3], "width_m": [0, 1, 2, 3],
                            "height_m": [0, 1, 2, 3], "weight": weight},
                }
            }
            for name, weight in (("a", 1.0), ("b", 1.0))
        }
    }  # fmt: skip
    result = _classify((1.5, 1.5, 1.5, 0, 1, 0), rules=Rules.model_validate(twins))
    assert result.labels == ("a",)
    assert result.confidences[0] == pytest.approx(0.5)
    strict = Rules.model_validate({**twins, "min_confidence": 0.6})
    doubtful = _classify((1.5, 1.5, 1.5, 0, 1, 0), rules=strict)
    assert doubtful.labels == (UNKNOWN,)
    assert doubtful.confidences[0] == pytest.approx(0.5)


def test_membership_is_smooth_and_ends_where_the_rules_say() -> None:
    shape = _RULES.classes["pedestrian"].shapes["upright"]
    low, first, last, high = shape.height_m
    heights = np.linspace(low - 0.2, high + 0.2, 400)
    rows = [(0.5, 0.4, float(h), 0.1, 0.5, 0.1) for h in heights]
    column = _RULES.labels.index("pedestrian")
    score = _classify(*rows).scores[:, column]
    assert (np.abs(np.diff(score)) < 0.03).all()
    assert (score[(heights <= low) | (heights >= high)] == 0).all()
    inside = (heights >= first) & (heights <= last)
    np.testing.assert_allclose(score[inside], shape.weight)


def test_confidences_and_scores_stay_in_range() -> None:
    rng = np.random.default_rng(3)
    rows = rng.uniform(-1, 12, (3000, 6)) ** [1, 1, 1, 1, 1, 0]
    rows[:, 5] = rng.choice([np.nan, 0.0, 0.5, 1.0], 3000)
    result = _classify(*map(tuple, rows))
    assert ((result.confidences >= 0) & (result.confidences <= 1)).all()
    assert ((result.scores >= 0) & (result.scores <= 1)).all()
    known = np.array([label != UNKNOWN for label in result.labels])
    assert (result.confidences[known] >= _RULES.min_confidence).all()


def test_no_cluster_gives_no_class() -> None:
    result = _classify()
    assert result.labels == ()
    assert result.scores.shape == (0, len(_RULES.labels))


def test_a_team_can_add_a_class(tmp_path: Path) -> None:
    path = tmp_path / "rules.yaml"
    box = {"length_m": [8, 9, 13, 15], "width_m": [1, 2, 3, 4], "height_m": [2, 2.5, 3.5, 4]}
    path.write_text(yaml.safe_dump({"classes": {"bus": {"shapes": {"side": box}}}}))
    result = _classify((11, 2.5, 3, 0.3, 0.5, 0.1), rules=load_rules(path))
    assert result.labels == ("bus",)
    assert result.confidences[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lenght_m": [1, 2, 3, 4]}, "length_m"),
        ({"length_m": [4, 3, 2, 1]}, "must rise"),
        ({"weight": 2.0}, "weight"),
    ],
)
def test_rules_that_cannot_be_right_are_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    shape = {"length_m": [0, 1, 2, 3], "width_m": [0, 1, 2, 3], "height_m": [0, 1, 2, 3]}
    content = {"classes": {"car": {"shapes": {"side": {**shape, **change}}}}}
    path = tmp_path / "rules.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match=message):
        load_rules(path)
