"""The verdict of a check, from what its pairs say together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from percept.calib.check.axes import size
from percept.calib.check.result import (
    AXES,
    AxisVerdict,
    CalibrationCheck,
    MovedSensor,
    PairCheck,
)
from percept.core.results import Verdict

__all__ = ["conclude"]

_WORSE = (Verdict.GOOD, Verdict.DOUBTFUL, Verdict.AMBIGUOUS, Verdict.BAD)
_MORE_SCENES = (
    "Record three places or more with walls, poles or vehicles in every direction, standing still"
)
_MORE_BOARDS = "Show the board in ten poses or more, turned 20 to 40 deg each way, near and far"


def conclude(check: CalibrationCheck, doubts: Sequence[str]) -> CalibrationCheck:
    """Return the check with its verdict, reasons and advice.

    Args:
        check: What was compared.
        doubts: What is odd about the data.
    """
    found = [
        *_moves(check),
        *_intrinsics(check),
        *_joined(check),
        *((Verdict.DOUBTFUL, doubt, _MORE_SCENES) for doubt in doubts),
    ]
    found.sort(key=lambda finding: -_WORSE.index(finding[0]))
    if not found:
        names = _names(check.pairs)
        holds = f"all axes of {', '.join(names)} hold, and a planted shift would have been found"
        return replace(check, verdict=Verdict.GOOD, why=(holds,), advice=())
    advice = tuple(dict.fromkeys(text for _, _, text in found if text))
    why = tuple(dict.fromkeys(reason for _, reason, _ in found))
    return replace(check, verdict=found[0][0], why=why, advice=advice)


_Finding = tuple[Verdict, str, str]


def _names(pairs: Sequence[PairCheck]) -> list[str]:
    return list(dict.fromkeys(name for pair in pairs for name in (pair.against, pair.sensor)))


def _moves(check: CalibrationCheck) -> Iterator[_Finding]:
    cameras = {pair.sensor for pair in check.pairs if pair.measured.kind == "camera"}
    cameras -= {pair.against for pair in check.pairs}
    for moved in check.moved:
        yield Verdict.BAD, _move_in_words(moved, check.pairs), _again(moved.sensor, cameras)
    if check.suspects:
        groups = " or ".join(" and ".join(f"'{n}'" for n in group) for group in check.suspects)
        reasons = "; ".join(
            f"{pair.against}-{pair.sensor}: {name} {axis.reason}"
            for pair in check.pairs
            for name, axis in pair.axes.items()
            if axis.verdict is AxisVerdict.MOVED
        )
        farthest = max(check.if_moved, key=lambda moved: moved.off_at_20_m)
        yield (
            Verdict.BAD,
            f"{groups} moved; the data cannot say which ({reasons}); {_at_20_m(farthest)}",
            "Look which of them was touched, or check with a third sensor; then calibrate anew "
            "with `percept calib lidar --initial` or `percept calib camera-lidar --initial`",
        )


def _move_in_words(moved: MovedSensor, pairs: Sequence[PairCheck]) -> str:
    axes = {
        name: axis
        for pair in pairs
        if pair.sensor == moved.sensor
        for name, axis in pair.axes.items()
        if axis.verdict is AxisVerdict.MOVED
    }
    delta = [*moved.delta_translation_m, *moved.delta_rotation_deg]
    parts = [
        f"{size(name, float(delta[AXES.index(name)]))} {'along' if name in AXES[:3] else 'in'} "
        f"{name}"
        for name in AXES
        if name in axes
    ]
    during = any("while the log was made" in (axis.reason or "") for axis in axes.values())
    return (
        f"'{moved.sensor}' moved{' while the log was made' if during else ''}: "
        f"{', '.join(parts) or 'see its pairs'}; {_at_20_m(moved)}"
    )


def _at_20_m(moved: MovedSensor) -> str:
    pixels = "" if moved.px_at_20_m is None else f" ({moved.px_at_20_m:.0f} px)"
    return f"a point 20 m away comes out up to {100 * moved.off_at_20_m:.0f} cm off{pixels}"


def _again(sensor: str, cameras: set[str]) -> str:
    command = "camera-lidar" if sensor in cameras else "lidar"
    return (
        f"Do not use the rig's place of '{sensor}': fasten it and calibrate anew with "
        f"`percept calib {command} --initial RIG`"
    )


def _intrinsics(check: CalibrationCheck) -> Iterator[_Finding]:
    for lens in check.intrinsics:
        if lens.verdict is not Verdict.GOOD:
            yield (
                Verdict.BAD,
                f"the intrinsics of '{lens.camera}' do not fit its images: {lens.why}",
                f"Calibrate '{lens.camera}' anew with `percept calib camera`",
            )


def _joined(check: CalibrationCheck) -> Iterator[_Finding]:
    """Look which sensors are tied to the others, and by which axes.

    Two LiDARs that share no view do not count against a rig when both hold against a third.
    """
    excluded = {moved.sensor for moved in check.moved}
    names = [name for name in _names(check.pairs) if name not in excluded]
    pairs = [p for p in check.pairs if not {p.sensor, p.against} & excluded]
    if len(names) < 2 or check.suspects:
        return
    every = _tied(names, dict.fromkeys(AXES, pairs))
    sound = [p for p in pairs if p.verdict in (Verdict.GOOD, Verdict.DOUBTFUL)]
    if not every:
        loose = [p for p in pairs if p.verdict is Verdict.AMBIGUOUS]
        verdict = Verdict.AMBIGUOUS if loose else Verdict.DOUBTFUL
        if not sound and not loose:
            verdict = Verdict.BAD
        for pair in pairs:
            if pair.verdict is not Verdict.GOOD:
                yield verdict, f"{pair.against}-{pair.sensor}: {pair.why}", _more(pair)
    elif not _tied(names, {name: [p for p in pairs if _firm(p)] for name in AXES}):
        for pair in pairs:
            if pair.verdict is Verdict.DOUBTFUL:
                yield Verdict.DOUBTFUL, f"{pair.against}-{pair.sensor}: {pair.why}", _more(pair)


def _more(pair: PairCheck) -> str:
    return _MORE_BOARDS if pair.measured.kind == "camera" else _MORE_SCENES


def _firm(pair: PairCheck) -> bool:
    return pair.measured.confirmed and pair.measured.verdict is Verdict.GOOD


def _tied(names: Sequence[str], pairs: dict[str, list[PairCheck]]) -> bool:
    """Whether every axis joins all sensors over pairs in which it holds."""
    for axis, candidates in pairs.items():
        group = {name: {name} for name in names}
        for pair in candidates:
            if pair.axes[axis].verdict is AxisVerdict.HOLDS:
                joined = group[pair.sensor] | group[pair.against]
                for name in joined:
                    group[name] = joined
        if any(len(group[name]) < len(names) for name in names):
            return False
    return True
