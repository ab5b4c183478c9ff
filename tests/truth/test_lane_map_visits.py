"""Several drives over one road, odd input, and what persons decided of findings before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
import pytest
from made_paint import MEDIUM, QUIET, World, drive, made_world, moved_aside
from paint_changes import changed, kinds, validated, with_ways, without

from percept.core.errors import InputError, UsageError
from percept.core.map_findings import Decision, Discrepancy, Kind, Status
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.hdmap.validate import LaneValidator, Validation

_LATER_NS = 10**12
_drive_by = partial(drive, first_m=45.0, last_m=185.0)  # along the ways 1010 to 1014
_CHANGES = 13


def test_the_order_of_drives_does_not_matter() -> None:
    world, _ = changed(made_world(240.0), 4, _CHANGES)

    poses, looks = drive(world, MEDIUM, 1)
    others, more = drive(world, MEDIUM, 2, start_ns=_LATER_NS, backward=True)
    kept, rest = [*looks], [*more]
    first = validated(world, (poses, iter(kept)), (others, iter(rest)))
    second = validated(world, (others, iter(rest)), (poses, iter(kept)))
    assert kinds(first) == kinds(second)
    assert max(finding.visits for finding in first.discrepancies) == 2
    pairs = zip(
        sorted(first.discrepancies, key=_place),
        sorted(second.discrepancies, key=_place),
        strict=True,
    )
    for a, b in pairs:
        assert a.confidence == pytest.approx(b.confidence, abs=1e-3)
        assert (a.observations, a.visits) == (b.observations, b.visits)


def _place(finding: Discrepancy) -> tuple[str, int, float]:
    return finding.kind.value, finding.map_element_id, round(float(finding.points_map[0, 0]), 1)


def test_visits_that_contradict_each_other_lower_the_confidence() -> None:
    world = made_world(200.0)
    gone = without(world, 1011)

    def looked_at(*roads: World) -> Validation:
        drives = [drive(road, MEDIUM, k, start_ns=k * _LATER_NS) for k, road in enumerate(roads)]
        return validated(world, *drives)

    (sure,) = looked_at(gone, gone).discrepancies
    (unsure,) = looked_at(gone, world).discrepancies
    assert sure.kind is unsure.kind is Kind.MISSING_ON_ROAD
    assert sure.confidence > 0.85 > 0.6 > unsure.confidence
    assert "on 1 of 2 visits" in unsure.observed


def test_a_line_that_lay_in_place_on_one_visit_is_less_surely_moved() -> None:
    world = made_world(200.0)
    aside = replace(world.road.ways[1010], points=moved_aside(world.road.ways[1010].points, 0.5))
    moved = with_ways(world, world.road.ways | {1010: aside})

    def looked_at(*roads: World) -> Discrepancy:
        drives = [_drive_by(road, QUIET, k, start_ns=k * _LATER_NS) for k, road in enumerate(roads)]
        (found,) = validated(world, *drives).discrepancies
        assert found.kind is Kind.MOVED
        return found

    assert looked_at(moved, moved).confidence > 0.85
    unsure = looked_at(moved, moved, world)
    assert "on 2 of 3 visits, in place on the others" in unsure.observed
    assert unsure.confidence < 0.6


def test_a_drive_that_comes_back_makes_another_visit() -> None:
    world = made_world(250.0)
    gone = without(world, 1010)
    (there, looks), (back, more) = (
        _drive_by(gone, MEDIUM, k, start_ns=k * _LATER_NS, backward=k == 1) for k in (0, 1)
    )
    poses = Trajectory(
        "map",
        "base_link",
        np.concatenate([there.stamps_ns, back.stamps_ns]),
        np.concatenate([there.matrices, back.matrices]),
    )
    (found,) = validated(world, (poses, iter([*looks, *more]))).discrepancies
    assert found.visits == 2


def test_a_vehicle_that_stands_still_finds_nothing_that_is_sure() -> None:
    world = made_world(200.0)
    poses, looks = drive(world, MEDIUM, 0)
    at, count = 60, 150
    look = next(islice(looks, at, None))
    stamps = poses.stamps_ns[at] + np.arange(count) * 10**8
    still = Trajectory("map", "base_link", stamps, np.repeat(poses.matrices[at : at + 1], count, 0))
    standing = [replace(look, stamp_ns=int(stamp)) for stamp in stamps]
    result = validated(world, (still, iter(standing)))
    assert [f.kind for f in result.discrepancies if f.confidence > 0.8] == []


def test_a_map_without_paint_is_refused() -> None:
    with pytest.raises(InputError, match="no painted lines"):
        LaneValidator((), {})
    marking = replace(made_world(100.0).markings[0], painted=False)
    with pytest.raises(InputError, match="no painted lines"):
        LaneValidator((marking,), {})


def test_a_log_from_elsewhere_is_refused_with_the_distance() -> None:
    world = made_world(100.0)
    poses, _ = drive(world, QUIET, 0)
    matrices = poses.matrices.copy()
    matrices[:, 1, 3] += 5_000.0
    with pytest.raises(InputError, match=r"no nearer than 5\.0 km"):
        LaneValidator(world.markings, {}).begin_drive("far", replace(poses, matrices=matrices))


def test_a_look_before_a_drive_is_refused() -> None:
    world = made_world(100.0)
    look = next(drive(world, QUIET, 0)[1])
    with pytest.raises(UsageError, match="needs a drive"):
        LaneValidator(world.markings, world.lanelets).push(look)


def test_few_looks_are_short_of_data() -> None:
    world = made_world(100.0)
    poses, looks = drive(world, QUIET, 0)
    nothing = validated(world, (poses, iter(())))
    assert (nothing.verdict, nothing.discrepancies) == (Verdict.BAD, ())
    assert "short of data" in nothing.why
    one = validated(world, (poses, iter([next(looks)])))
    assert (one.verdict, one.discrepancies) == (Verdict.BAD, ())


def test_numbers_that_are_none_are_left_out_and_counted() -> None:
    world = made_world(200.0)
    poses, looks = drive(world, MEDIUM, 0)
    spoilt = []
    for look in looks:
        strokes, ends = look.strokes_m.copy(), look.bars_m.copy()
        strokes[::7] = np.nan
        ends[:] = np.inf
        spoilt.append(replace(look, strokes_m=strokes, bars_m=ends))
    matrices = poses.matrices.copy()
    matrices[20:30] = np.nan
    torn = replace(world.markings[0], points_map=np.full((4, 3), np.nan))
    short = replace(world.markings[0], points_map=np.zeros((2, 3)))
    world = replace(world, markings=(*world.markings, torn, short))
    result = validated(world, (replace(poses, matrices=matrices), iter(spoilt)))
    assert {f.kind for f in result.discrepancies} <= {Kind.STOP_LINE_MISSING}
    assert result.dropped["strokes with numbers that are not finite"] > 100
    assert result.dropped["looks with a pose that is not rigid"] >= 10
    assert result.dropped["markings of the map without two finite points"] == 1
    assert result.dropped["markings of the map without a length"] == 1


def test_looks_outside_the_poses_are_counted() -> None:
    world = made_world(100.0)
    poses, looks = drive(world, QUIET, 0)
    late = [replace(look, stamp_ns=look.stamp_ns + 10**15) for look in looks]
    result = validated(world, (poses, iter(late)))
    assert result.dropped["looks without a pose"] == len(late)
    assert result.verdict is Verdict.BAD


_Decided = tuple[Callable[..., Validation], Validation]


@pytest.fixture(scope="module")
def decided() -> _Decided:
    world, _ = changed(made_world(240.0), 3, _CHANGES)
    poses, looks = drive(world, MEDIUM, 3)
    kept = [*looks]

    def run(*decisions: Decision) -> Validation:
        return validated(world, (poses, iter(kept)), decisions=decisions)

    return run, run()


def _decision(finding: Discrepancy, status: Status) -> Decision:
    middle = finding.points_map[:, :2].mean(axis=0)
    return Decision(
        finding_id=finding.finding_id, status=status, comment="", kind=finding.kind,
        map_element_id=finding.map_element_id, along_m=finding.along_m,
        length_m=finding.length_m, x_m=float(middle[0]), y_m=float(middle[1]),
        offset_m=finding.offset_m,
    )  # fmt: skip


def test_what_was_rejected_does_not_return(decided: _Decided) -> None:
    run, before = decided
    rejected = [_decision(finding, Status.REJECTED) for finding in before.discrepancies]
    after = run(*rejected)
    assert after.discrepancies == ()
    assert after.counts["findings that a person rejected before"] == len(rejected) > 9


def test_what_was_confirmed_keeps_its_status_and_name(decided: _Decided) -> None:
    run, before = decided
    renamed = replace(_decision(before.discrepancies[0], Status.CONFIRMED), finding_id="as it was")
    after = run(renamed)
    assert len(after.discrepancies) == len(before.discrepancies)
    (found,) = [f for f in after.discrepancies if f.status is Status.CONFIRMED]
    assert (found.finding_id, found.kind) == ("as it was", before.discrepancies[0].kind)


def test_a_line_that_moved_on_since_it_was_rejected_is_new(decided: _Decided) -> None:
    run, before = decided
    moved = next(f for f in before.discrepancies if f.kind is Kind.MOVED)
    decision = replace(_decision(moved, Status.REJECTED), offset_m=-moved.offset_m)
    assert kinds(run(decision)) == kinds(before)


def test_the_last_of_two_decisions_counts(decided: _Decided) -> None:
    run, before = decided
    first = before.discrepancies[0]
    after = run(_decision(first, Status.REJECTED), _decision(first, Status.CONFIRMED))
    assert kinds(after) == kinds(before)
