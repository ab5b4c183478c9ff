"""A rig from registrations: chains, round trips, failures, odd input. The pairs are made up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.lidars import calibrate as lidar_lidar
from percept.calib.lidars.calibrate import calibrate_lidars
from percept.calib.lidars.pair_result import PairRegistration, Rival
from percept.calib.lidars.result import LidarCalibration, worst_verdict
from percept.calib.lidars.scenes import prepare_scenes
from percept.calib.limits import LidarLimits
from percept.core.errors import GeometryError, InputError, UsageError
from percept.core.results import Verdict
from percept.core.transform import rotation_from_rpy

Matrix = NDArray[np.float64]

_SIZES = {"top": 500, "left": 401, "right": 302, "bottom": 203}
_SD = np.array([5e-4] * 3 + [0.002] * 3)


def _pose(x: float, y: float, z: float, yaw: float = 0.0, roll: float = 0.0) -> Matrix:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(roll, 0.1, yaw)
    T[:3, 3] = x, y, z
    return T


_RIG = {
    "top": np.eye(4),
    "left": _pose(0.1, 0.7, -0.3, 1.4),
    "right": _pose(0.1, -0.7, -0.3, -1.4),
    "bottom": _pose(2.5, 0.0, -1.4, 0.0, np.pi),
}


class Pairs:
    """Stands for `register_views`: knows the sensors by the numbers of their points."""

    def __init__(self) -> None:
        self.verdicts: dict[frozenset[str], Verdict] = {}
        self.overlaps: dict[frozenset[str], float] = {}
        self.errors: dict[frozenset[str], Matrix] = {}
        self.nothing: set[frozenset[str]] = set()
        self.calls: list[tuple[str, str]] = []
        self.guesses: dict[tuple[str, str], Any] = {}
        self.scenes: dict[tuple[str, str], int] = {}

    def __call__(
        self, scenes: Any, _config: Any, initial: Any = None, **named: Any
    ) -> PairRegistration:
        names = {size: name for name, size in _SIZES.items()}
        target, source = (names[len(cloud) // _joined(scenes)] for cloud in scenes[0])
        self.calls.append((target, source))
        self.guesses[target, source] = initial
        self.scenes[target, source] = len(scenes)
        pair = frozenset((target, source))
        T = np.linalg.inv(_RIG[target]) @ _RIG[source] @ self.errors.get(pair, np.eye(4))
        verdict = self.verdicts.get(pair, Verdict.GOOD)
        if pair in self.nothing:
            verdict = Verdict.BAD
        return PairRegistration(
            T_target_source=None if pair in self.nothing else T,
            scene_T_target_source=(T,) * len(scenes),
            sd_translation_m=_SD[3:],
            sd_rotation_deg=np.degrees(_SD[:3]),
            leave_one_out=(0.001, 0.02) if len(scenes) > 1 else None,
            rms_m=0.02,
            overlap=self.overlaps.get(pair, 0.4),
            overlap_05=0.6,
            scenes_agreeing=(len(scenes), len(scenes)),
            weak_directions=("forward x",) if verdict is Verdict.DOUBTFUL else (),
            information=np.diag(_SD**-2.0),
            structure_share=0.5,
            free_space_violation=0.01,
            range_offset_m=0.001,
            range_offset_sd_m=0.005,
            rivals=(Rival(T @ _pose(0, 0, 0, np.pi), 0.4, 0.01, 1, close=True),)
            if verdict is Verdict.AMBIGUOUS
            else (),
            verdict=verdict,
            why=(f"Scene {' and '.join(named['names'])} says so.",),
            advice=(f"Do {verdict}",),
            dropped_points={},
            scenes_left_out={},
        )


def _joined(scenes: Any) -> int:
    """How many scenes a cloud was joined of."""
    return int(len(scenes[0][0]) // next(s for s in _SIZES.values() if len(scenes[0][0]) % s == 0))


@pytest.fixture
def pairs(monkeypatch: pytest.MonkeyPatch) -> Pairs:
    stand_in = Pairs()
    monkeypatch.setattr(lidar_lidar, "register_views", stand_in)
    monkeypatch.setattr(lidar_lidar, "view_of", lambda cloud, _config: cloud)
    monkeypatch.setattr(lidar_lidar, "_shared_view", lambda *_: 0.5)
    return stand_in


def _scene(seed: int, names: Any = tuple(_SIZES)) -> dict[str, Matrix]:
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(-30, 30, size=(_SIZES[name], 3)) for name in names}


def _scenes(count: int = 3) -> list[dict[str, Matrix]]:
    return [_scene(seed) for seed in range(count)]


def _entry(result: LidarCalibration, name: str) -> Any:
    return next(e for e in result.extrinsics if e.sensor == name)


def test_a_rig_that_agrees_is_good_and_every_pair_checks_the_others(pairs: Pairs) -> None:
    shares: list[float] = []
    result = calibrate_lidars(_scenes(), "top", progress=shares.append)
    assert result.verdict is Verdict.GOOD
    assert [e.sensor for e in result.extrinsics] == ["left", "right", "bottom"]
    for name in ("left", "right", "bottom"):
        assert np.allclose(_entry(result, name).T_reference_sensor, _RIG[name], atol=1e-9)
    assert len({frozenset(call) for call in pairs.calls}) == len(pairs.calls) == 6
    assert len(result.loops) == 3
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    # Registrations that share clouds check each other, and do not know more for their number.
    assert _entry(result, "left").sd_translation_m == pytest.approx(_SD[3:], rel=0.2)


def test_the_document_has_the_promised_keys_and_no_nan(pairs: Pairs) -> None:
    import json

    pairs.nothing = {frozenset(("top", "left")), frozenset(("right", "left"))}
    pairs.nothing |= {frozenset(("bottom", "left"))}
    document = calibrate_lidars(_scenes(), "top").as_json()
    text = json.dumps(document, allow_nan=False)
    assert json.loads(text) == document
    assert document["reference"] == "top"
    entry = document["extrinsics"][1]
    wanted = {
        "sensor", "T_reference_sensor", "translation_m", "quat_xyzw", "sd_translation_m",
        "sd_rotation_deg", "leave_one_out_max", "rms_m", "overlap", "scenes_agreeing",
        "weak_directions", "verdict", "why",
    }  # fmt: skip
    assert wanted <= set(entry)
    assert np.shape(entry["T_reference_sensor"]) == (4, 4)
    assert entry["scenes_agreeing"] == "3/3"
    assert set(entry["leave_one_out_max"]) == {"translation_m", "rotation_deg"}
    assert document["extrinsics"][0]["T_reference_sensor"] is None
    assert {"path", "translation_m", "rotation_deg"} <= set(document["loops"][0])


@pytest.mark.parametrize("verdict", [Verdict.BAD, Verdict.AMBIGUOUS])
def test_a_sensor_that_the_reference_does_not_see_is_placed_along_a_chain(
    pairs: Pairs, verdict: Verdict
) -> None:
    pairs.verdicts[frozenset(("top", "bottom"))] = verdict
    pairs.overlaps[frozenset(("top", "bottom"))] = 0.4 if verdict is Verdict.AMBIGUOUS else 0.02
    result = calibrate_lidars(_scenes(), "top")
    bottom = _entry(result, "bottom")
    assert bottom.path[0] == "top"
    assert len(bottom.path) == 3
    assert np.allclose(bottom.T_reference_sensor, _RIG["bottom"], atol=1e-9)
    assert bottom.verdict is Verdict.GOOD
    assert "placed by way of" in bottom.why
    assert bottom.leave_one_out_translation_m > 0.002
    # The failed registration is no edge: it closes no round trip.
    assert all(("top", "bottom") not in zip(x.path, x.path[1:], strict=False) for x in result.loops)


def test_a_chain_does_not_talk_away_a_failure_in_plain_sight(pairs: Pairs) -> None:
    pairs.verdicts[frozenset(("top", "bottom"))] = Verdict.BAD
    bottom = _entry(calibrate_lidars(_scenes(), "top"), "bottom")
    assert bottom.verdict is Verdict.DOUBTFUL
    assert "registered with 'top' it failed" in bottom.why
    pairs.verdicts[frozenset(("top", "bottom"))] = Verdict.AMBIGUOUS
    pairs.errors[frozenset(("top", "bottom"))] = _pose(1, 0, 0, 0.5)
    assert _entry(calibrate_lidars(_scenes(), "top"), "bottom").verdict is Verdict.DOUBTFUL


def test_one_sensor_that_fails_does_not_spoil_the_others(pairs: Pairs) -> None:
    for other in ("top", "left", "right"):
        pairs.verdicts[frozenset((other, "bottom"))] = Verdict.BAD
    result = calibrate_lidars(_scenes(), "top")
    assert _entry(result, "left").verdict is Verdict.GOOD
    assert _entry(result, "right").verdict is Verdict.GOOD
    assert _entry(result, "bottom").verdict is Verdict.BAD
    assert "nor could it be placed by way of left, right" in _entry(result, "bottom").why
    assert result.verdict is Verdict.BAD
    assert result.why[0].startswith("bottom (bad): ")


def test_an_ambiguous_sensor_shows_its_rivals(pairs: Pairs) -> None:
    scenes = [{n: s[n] for n in ("top", "left")} for s in _scenes()]
    pairs.verdicts[frozenset(("top", "left"))] = Verdict.AMBIGUOUS
    result = calibrate_lidars(scenes, "top")
    assert result.verdict is Verdict.AMBIGUOUS
    assert len(_entry(result, "left").rivals) == 1
    assert "Do ambiguous" in result.advice


def test_a_wrong_registration_among_four_is_named_and_left_out(pairs: Pairs) -> None:
    pairs.errors[frozenset(("top", "left"))] = _pose(0, 0, 0, np.pi)
    result = calibrate_lidars(_scenes(), "top")
    left = _entry(result, "left")
    assert np.allclose(left.T_reference_sensor, _RIG["left"], atol=1e-6)
    assert left.verdict is Verdict.DOUBTFUL
    assert "top-left contradicts all others" in left.why
    assert not all(loop.agrees for loop in result.loops)
    assert _entry(result, "right").verdict is Verdict.GOOD


def test_a_wrong_registration_among_three_makes_its_sensors_bad(pairs: Pairs) -> None:
    scenes = [{n: s[n] for n in ("top", "left", "right")} for s in _scenes()]
    pairs.errors[frozenset(("top", "left"))] = _pose(0, 0, 0, np.pi)
    result = calibrate_lidars(scenes, "top")
    assert {e.verdict for e in result.extrinsics} == {Verdict.BAD}
    assert "round trip" in _entry(result, "left").why
    assert "one of its registrations is wrong" in _entry(result, "left").why


def test_a_small_miss_of_a_round_trip_is_doubtful(pairs: Pairs) -> None:
    scenes = [{n: s[n] for n in ("top", "left", "right")} for s in _scenes()]
    shift = np.eye(4)
    shift[0, 3] = 0.04
    pairs.errors[frozenset(("left", "right"))] = shift
    result = calibrate_lidars(scenes, "top")
    assert {e.verdict for e in result.extrinsics} == {Verdict.DOUBTFUL}
    assert _entry(result, "left").rpy_deg()[2] == pytest.approx(np.degrees(1.4), abs=2)
    assert result.loops[0].translation_m == pytest.approx(0.04, abs=0.01)


def test_two_sensors_and_one_scene(pairs: Pairs) -> None:
    pairs.verdicts[frozenset(("top", "left"))] = Verdict.DOUBTFUL
    result = calibrate_lidars([_scene(0, ("top", "left"))], "top")
    left = _entry(result, "left")
    assert left.leave_one_out_translation_m is None
    assert left.as_json()["leave_one_out_max"] == {"translation_m": None, "rotation_deg": None}
    assert not result.loops
    assert any("other places" in text for text in result.advice)
    assert any("forward x" in text for text in result.advice)


def test_given_places_are_guesses_and_say_when_names_are_exchanged(pairs: Pairs) -> None:
    start = {**_RIG, "left": _RIG["right"], "right": _RIG["left"]}
    result = calibrate_lidars(_scenes(), "top", initial=start)
    assert np.allclose(pairs.guesses["top", "left"], _RIG["right"])
    for name in ("left", "right"):
        assert _entry(result, name).verdict is Verdict.DOUBTFUL
        assert "has the other one" in _entry(result, name).why
        assert np.allclose(_entry(result, name).T_reference_sensor, _RIG[name], atol=1e-9)
    assert _entry(result, "bottom").verdict is Verdict.GOOD


def test_the_reference_exchanged_with_a_sensor_is_noticed(pairs: Pairs) -> None:
    del pairs
    scenes = [{n: s[n] for n in ("top", "left")} for s in _scenes()]
    start = {"left": np.linalg.inv(_RIG["left"])}
    result = calibrate_lidars(scenes, "top", initial=start)
    assert "'top' and 'left' were found where" in _entry(result, "left").why


def test_a_wrong_guess_is_no_reason_for_doubt(pairs: Pairs) -> None:
    start = {name: T @ _pose(0.2, 0, 0, 0.8) for name, T in _RIG.items() if name != "top"}
    assert calibrate_lidars(_scenes(), "top", initial=start).verdict is Verdict.GOOD
    assert pairs.guesses["top", "left"] is not None


def test_clouds_that_do_not_count_are_dropped_and_named(pairs: Pairs) -> None:
    scenes = _scenes(4)
    scenes[1]["left"] = np.full((50, 3), np.nan)
    scenes[2]["left"] = np.zeros((0, 3))
    scenes[3]["right"] = np.vstack([scenes[3]["right"], [[np.inf, 0, 0], [0, 0, 0]]])
    result = calibrate_lidars(scenes, "top")
    assert pairs.scenes["top", "left"] == 2
    assert pairs.scenes["top", "right"] == 4
    assert result.dropped["clouds of left without a point"] == 2
    assert result.dropped["points of right that are not finite or at its origin"] == 2
    # Scenes keep the numbers that they were given under.
    assert "Scene 1 and 4 says so" in _entry(result, "left").why


def test_a_sensor_without_any_cloud_is_bad_by_itself(pairs: Pairs) -> None:
    scenes = _scenes()
    for scene in scenes:
        scene["bottom"] = np.zeros((0, 3))
    result = calibrate_lidars(scenes, "top")
    assert "no scene has points of 'bottom'" in _entry(result, "bottom").why
    assert _entry(result, "left").verdict is Verdict.GOOD
    assert ("top", "bottom") not in pairs.calls


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda scenes: scenes[0].update(left=scenes[0]["top"].copy()), "same cloud"),
        (lambda scenes: scenes[2].update(left=scenes[0]["right"] + 1e-4), "same cloud"),
    ],
)
def test_one_cloud_for_two_sensors_is_an_error(
    change: Callable[[Any], None], what: str, pairs: Pairs
) -> None:
    del pairs
    scenes = _scenes()
    change(scenes)
    with pytest.raises(InputError, match=what):
        calibrate_lidars(scenes, "top")


def test_a_scene_that_is_there_twice_counts_once(pairs: Pairs) -> None:
    scenes = _scenes(2)
    scenes.append({name: points + 1e-4 for name, points in scenes[0].items()})
    result = calibrate_lidars(scenes, "top")
    assert pairs.scenes["top", "left"] == 2
    assert result.scenes == 2
    assert result.dropped["clouds of left that are there twice"] == 1


def test_scenes_of_one_place_are_joined(pairs: Pairs) -> None:
    rng = np.random.default_rng(0)
    first = _scene(1)
    again = {n: p + 0.01 * rng.normal(size=p.shape) for n, p in first.items()}
    result = calibrate_lidars([first, again], "top")
    assert pairs.scenes["top", "left"] == 1
    assert result.scenes == 1
    assert result.dropped["scenes joined with another of the same place"] == 1


def test_a_sensor_that_turns_while_the_others_stand_is_named(pairs: Pairs) -> None:
    del pairs
    rng = np.random.default_rng(0)
    first = _scene(1)
    again = {n: p + 0.01 * rng.normal(size=p.shape) for n, p in first.items()}
    again["left"] = again["left"] @ rotation_from_rpy(0, 0, 0.2).T
    prepared = prepare_scenes([first, again], "top", LidarLimits())
    assert len(prepared.clouds) == 2
    assert "'left' sees two" in prepared.doubts[0]
    assert calibrate_lidars([first, again], "top").verdict is Verdict.DOUBTFUL


def test_what_is_given_is_not_changed(pairs: Pairs) -> None:
    del pairs
    scenes = _scenes()
    copies = [{name: points.copy() for name, points in scene.items()} for scene in scenes]
    calibrate_lidars(scenes, "top")
    for scene, copy in zip(scenes, copies, strict=True):
        assert all(np.array_equal(scene[name], copy[name]) for name in scene)


@pytest.mark.parametrize(
    ("scenes", "reference", "error"),
    [
        ([], "top", UsageError),
        ([{}], "top", UsageError),
        ([{"top": np.ones((5, 3))}], "top", UsageError),
        ([{"top": np.ones((5, 3)), "left": np.ones((6, 3))}], "roof", UsageError),
        ([{"top": np.ones((5, 2)), "left": np.ones((6, 3))}], "top", GeometryError),
    ],
)
def test_input_that_makes_no_sense_is_an_error(
    scenes: Any, reference: str, error: type[Exception]
) -> None:
    with pytest.raises(error):
        calibrate_lidars(scenes, reference)


def test_the_worst_verdict_wins() -> None:
    assert worst_verdict([]) is Verdict.GOOD
    assert worst_verdict([Verdict.DOUBTFUL, Verdict.GOOD]) is Verdict.DOUBTFUL
    assert worst_verdict([Verdict.AMBIGUOUS, Verdict.BAD, Verdict.DOUBTFUL]) is Verdict.BAD


def test_a_result_that_the_clouds_speak_against_is_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = Pairs()
    stand_in.errors[frozenset(("top", "left"))] = _pose(0.5, 0.5, 0.5, 0.3)
    monkeypatch.setattr(lidar_lidar, "register_views", stand_in)
    monkeypatch.setattr(lidar_lidar, "view_of", lambda cloud, _config: cloud)
    room = [_room(seed) for seed in range(2)]
    start = {"left": _RIG["left"]}
    left = _entry(calibrate_lidars(room, "top", initial=start), "left")
    assert left.verdict is Verdict.BAD
    assert "worse than the given start" in left.why
    stand_in.errors = {}
    assert _entry(calibrate_lidars(room, "top", initial=start), "left").verdict is Verdict.GOOD


def _room(seed: int) -> dict[str, Matrix]:
    """Return the walls of a room as two sensors see them, with their numbers of points."""
    rng = np.random.default_rng(seed)
    scene = {}
    for name in ("top", "left"):
        count = _SIZES[name]
        points = rng.uniform(-1, 1, size=(count, 3)) * [8, 5 + seed, 2]
        side = rng.integers(0, 4, size=count)
        points[side == 0, 0], points[side == 1, 0] = 8, -8
        points[side == 2, 1], points[side == 3, 1] = 5 + seed, -5 - seed
        T = np.linalg.inv(_RIG[name])
        scene[name] = points @ T[:3, :3].T + T[:3, 3]
    return scene
