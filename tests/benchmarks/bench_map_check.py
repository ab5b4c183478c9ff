"""Rules that a map can break by itself, against the issues that a published validator expects.

    python tests/benchmarks/bench_map_check.py --data ../shared/data

For each rule: the maps that it is held to, the issues found that are expected (the same number
and primitive, as often), precision and recall; below it what is found and not expected, and what
is missed. Then how long a made map of 200,000 points takes.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from percept.hdmap import load_map
from percept.hdmap.check import RULES, check_map

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "truth"))
from map_check_oracle import FOLDER, RuleScore, score_rules

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_ROADS, _PIECES, _LANES, _STEPS = 200, 25, 3, 10
_PIECE_M, _LANE_M, _ROAD_M = 50.0, 3.5, 20.0


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    arguments = parser.parse_args()
    folder = arguments.data / FOLDER
    if folder.is_dir():
        print_scores(score_rules(folder))
    else:
        print(f"{folder} is missing: no table of expected issues")
    print_speed()


def print_scores(scores: dict[str, RuleScore | None]) -> None:
    """Print a line for each rule, and one for all of them."""
    total = RuleScore()
    print(f"{'rule':<75} maps right precision recall")
    for name, score in sorted(scores.items()):
        if score is None:
            print(f"{name:<75} not implemented")
            continue
        print(f"{name:<75} {_figures(score)}")
        for word, maps in (("not expected", score.wrong), ("missed", score.missed)):
            for map_name, counts in maps.items():
                for (code, primitive_id), count in sorted(counts.items()):
                    print(f"    {word}: {map_name}: {code} at {primitive_id}, {count} x")
        total.maps += score.maps
        total.right += score.right
        total.wrong[name] = sum(score.wrong.values(), Counter())
        total.missed[name] = sum(score.missed.values(), Counter())
    print(f"{'all':<75} {_figures(total)}")


def _figures(score: RuleScore) -> str:
    return f"{score.maps:4d} {score.right:5d} {score.precision:9.3f} {score.recall:6.3f}"


def print_speed() -> None:
    """Print what reading and checking a large map takes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.osm"
        path.write_text("\n".join(_roads()), encoding="utf-8")
        start = time.perf_counter()
        hd_map = load_map(path)
        read = time.perf_counter()
        issues = check_map(hd_map)
        checked = time.perf_counter()
    print(
        f"\n{len(hd_map.points)} points, {len(hd_map.lanelets)} lanelets, {len(RULES)} rules: "
        f"read in {read - start:.1f} s, checked in {checked - read:.1f} s, {len(issues)} issues"
    )


def _roads() -> Iterator[str]:
    """Yield the lines of a map of winding roads side by side."""
    yield "<osm>"
    along = _PIECES * _STEPS + 1
    for road in range(_ROADS):
        for line in range(_LANES + 1):
            for step in range(along):
                x = step * _PIECE_M / _STEPS
                y = road * _ROAD_M + line * _LANE_M + 2.0 * math.sin(x / 40.0)
                node = 1 + step + along * (line + (_LANES + 1) * road)
                yield (
                    f'<node id="{node}" lat="" lon=""><tag k="local_x" v="{x:.3f}"/>'
                    f'<tag k="local_y" v="{y:.3f}"/><tag k="ele" v="{0.02 * x:.3f}"/></node>'
                )
    for road in range(_ROADS):
        for piece in range(_PIECES):
            yield from _piece(road, piece, along)
    yield "</osm>"


def _piece(road: int, piece: int, along: int) -> Iterator[str]:
    first_way = 10_000_000 + (road * _PIECES + piece) * (_LANES + 1)
    for line in range(_LANES + 1):
        first = 1 + piece * _STEPS + along * (line + (_LANES + 1) * road)
        nodes = "".join(f'<nd ref="{first + step}"/>' for step in range(_STEPS + 1))
        yield (
            f'<way id="{first_way + line}">{nodes}<tag k="type" v="line_thin"/>'
            '<tag k="subtype" v="dashed"/><tag k="lane_change" v="yes"/></way>'
        )
    for lane in range(_LANES):
        yield (
            f'<relation id="{20_000_000 + (road * _PIECES + piece) * _LANES + lane}">'
            f'<member type="way" role="left" ref="{first_way + lane + 1}"/>'
            f'<member type="way" role="right" ref="{first_way + lane}"/>'
            '<tag k="type" v="lanelet"/><tag k="subtype" v="road"/>'
            '<tag k="location" v="urban"/><tag k="one_way" v="yes"/></relation>'
        )


if __name__ == "__main__":
    main()
