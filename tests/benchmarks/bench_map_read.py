"""Reading maps: a large Lanelet2 map against the lanelet2 package.

    python tests/benchmarks/bench_map_read.py [--points 200000]

The map is eleven lines side by side, cut into pieces of 20 points, with lanelets between them.
Both readers build points, line strings and lanelets; ours also markings, rules and where the map
lies, and the line says how long the graph of lanelets takes on top.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import lanelet2

from percept.hdmap import load_map

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "truth"))
from made_osm import lanelet, node, way, write_osm

_LINES, _PIECE, _ROUNDS = 11, 20, 3
_LATITUDE, _LONGITUDE = 49.0, 8.4


def main() -> None:
    """Print the times of both readers and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=200_000)
    count = parser.parse_args().points
    with tempfile.TemporaryDirectory() as folder:
        path = write_osm(Path(folder) / "map.osm", *_elements(count))
        megabytes = path.stat().st_size / 1e6
        ours = _fastest(lambda: load_map(path))
        routing = _fastest(lambda: load_map(path).routing) - ours
        projector = lanelet2.projection.UtmProjector(lanelet2.io.Origin(_LATITUDE, _LONGITUDE))
        theirs = _fastest(lambda: lanelet2.io.load(str(path), projector))
    print(f"{count} points, {megabytes:.0f} MB")
    print(f"percept {ours:.2f} s, of lanelets {max(routing, 0.0):.2f} s more for their graph")
    print(f"lanelet2 {theirs:.2f} s; ratio {ours / theirs:.2f}")


def _fastest(work: Callable[[], object]) -> float:
    times = []
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def _elements(count: int) -> Iterator[str]:
    pieces = max(1, count // (_LINES * (_PIECE - 1)))
    for column in range(pieces * (_PIECE - 1) + 1):
        for row in range(_LINES):
            x, y = 2.0 * column, 3.5 * row + 50 * math.sin(column / 200)
            place = f'lat="{_LATITUDE + y / 111_200:.11f}" lon="{_LONGITUDE + x / 73_000:.11f}"'
            yield node(1 + column * _LINES + row, x, y, 100.0).replace('lat="" lon=""', place)
    lines, lanes = 10_000_000, 20_000_000
    for piece in range(pieces):
        for row in range(_LINES):
            columns = range(piece * (_PIECE - 1), (piece + 1) * (_PIECE - 1) + 1)
            ids = [1 + column * _LINES + row for column in columns]
            yield way(lines + piece * _LINES + row, ids, type="line_thin", subtype="dashed")
        for row in range(_LINES - 1):
            low = lines + piece * _LINES + row
            yield lanelet(lanes + piece * _LINES + row, [low + 1], [low], one_way="yes")


if __name__ == "__main__":
    main()
