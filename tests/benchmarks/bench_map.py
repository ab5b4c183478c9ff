"""Lanes against the HD map: planted changes found, false findings, a shifted map, on many worlds.

    python tests/benchmarks/bench_map.py --work bench_map --worlds 5 --noise 0 1 2

Each world is driven once for each noise; drives are kept in --work and made again only when they
are missing. `percept map validate` compares each with three maps:

- the map with planted changes, of all kinds: precision, recall and F1 by kind, by the rules of
  `percept eval map`;
- the map as the road is: false findings a kilometre;
- the same map as a whole 0.5 m to the left: one finding of a global offset, and no others.

A drive of 30 s takes about a minute to make, and each comparison some seconds.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.datasets.synthetic.drive import MAP_ORIGIN, DriveConfig, generate_drive
from percept.datasets.synthetic.lanelet_map import make_map, write_map
from percept.datasets.synthetic.world import World

_SHIFT_M = 0.5
_BLOCKS_BEHIND, _BLOCKS_AHEAD, _BLOCK_S = 2, 4, 15.0
_KINDS_OF_LIGHTS = ("traffic_light_missing", "traffic_light_missing_in_map")


@dataclass(frozen=True)
class Trial:
    """One drive with its three maps."""

    world: int
    noise: float
    folder: Path

    def map_file(self, name: str) -> Path:
        """Return the map `changed`, `same` or `shifted`."""
        return self.folder / ("map.osm" if name == "changed" else f"{name}.osm")


def main() -> None:
    """Make what is missing, compare, and print all tables."""
    arguments = _arguments()
    trials = list(_trials(arguments))
    found: dict[float, Counter[tuple[str, str]]] = defaultdict(Counter)
    for trial in trials:
        make_trial(trial, arguments)
        report(trial, arguments, found[trial.noise])
    print_tables(found)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("bench_map"))
    parser.add_argument("--worlds", type=int, default=5)
    parser.add_argument("--first-world", type=int, default=11)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 1.0, 2.0])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--changes", type=int, default=10)
    parser.add_argument("--again", action="store_true", help="compare again what was compared")
    return parser.parse_args()


def _trials(arguments: argparse.Namespace) -> Iterator[Trial]:
    for world in range(arguments.first_world, arguments.first_world + arguments.worlds):
        for noise in arguments.noise:
            name = f"w{world}_n{noise:g}_s{arguments.seconds:g}_c{arguments.changes}"
            yield Trial(world, noise, arguments.work / name)


def make_trial(trial: Trial, arguments: argparse.Namespace) -> None:
    """Make the drive and its maps, unless they are there."""
    done = trial.map_file("shifted")
    if done.is_file():
        return
    config = DriveConfig(
        seed=trial.world,
        seconds=arguments.seconds,
        noise=trial.noise,
        beam_share=0.25,
        map_changes=arguments.changes,
    )
    began = time.monotonic()
    generate_drive(config, trial.folder)
    blocks = range(-_BLOCKS_BEHIND, _BLOCKS_AHEAD + int(arguments.seconds / _BLOCK_S))
    street = make_map(World.from_seed(trial.world), MAP_ORIGIN, blocks)
    write_map(street, trial.map_file("same"))
    street.nodes = {node: (x, y + _SHIFT_M, z) for node, (x, y, z) in street.nodes.items()}
    write_map(street, done)
    print(f"made {trial.folder} in {time.monotonic() - began:.0f} s", flush=True)


def report(trial: Trial, arguments: argparse.Namespace, found: Counter[tuple[str, str]]) -> None:
    """Compare a drive with its maps, print a line, and add up what was found."""
    head = f"world {trial.world}, noise {trial.noise:g}: "
    changed = scores(trial, "changed", again=arguments.again)
    _add(found, "changed", changed)
    print(f"{head}changes {_in_words(changed)}", flush=True)
    same = scores(trial, "same", again=arguments.again)
    _add(found, "same", same)
    print(f"{head}same map {_falsely(same)}", flush=True)
    shifted = scores(trial, "shifted", again=arguments.again)
    kinds = Counter(one["kind"] for one in shifted["false_findings"])
    found["shifted", "maps"] += 1
    found["shifted", "right"] += kinds == {"global_offset": 1}
    print(f"{head}shifted map {dict(kinds) or 'nothing found'}", flush=True)


def scores(trial: Trial, name: str, *, again: bool) -> dict[str, Any]:
    """Return what `percept eval map` says of a comparison, made if it is missing."""
    run = trial.folder / f"run_{name}"
    if again or not (run / "run.json").is_file():
        _percept(
            "map", "validate", "--bag", trial.folder / "drive.mcap", "--map", trial.map_file(name),
            "--rig", trial.folder / "rig.yaml", "--out", run, "--force",
        )  # fmt: skip
    truth = trial.folder / "truth" / "map_changes.json"
    if name != "changed":
        truth = trial.folder / "nothing.json"
        truth.write_text("[]\n")
    document: dict[str, Any] = json.loads(_percept("eval", "map", run, "--truth", truth, "--json"))
    return document


def _percept(*arguments: object) -> str:
    command = [sys.executable, "-m", "percept.cli", *(str(argument) for argument in arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 4):
        raise SystemExit(f"{' '.join(command[2:])}\n{done.stderr}")
    return done.stdout


def _add(found: Counter[tuple[str, str]], name: str, document: dict[str, Any]) -> None:
    for kind, counts in document["by_kind"].items():
        for figure in ("planted", "found", "false"):
            found[f"{name}/{kind}", figure] += counts[figure]
    found[name, "metres"] += round(1000 * (document["driven_km"] or 0.0))


def _in_words(document: dict[str, Any]) -> str:
    missed = [one["kind"] for one in document["missed_changes"]]
    words = f"{document['found']} of {document['planted']} found"
    return f"{words}, missed {', '.join(missed) or 'none'}; {_falsely(document)}"


def _falsely(document: dict[str, Any]) -> str:
    false = Counter(one["kind"] for one in document["false_findings"])
    return f"{document['false']} false {dict(false) if false else ''}".strip()


def print_tables(found: dict[float, Counter[tuple[str, str]]]) -> None:
    """Print the sums over worlds, for each noise and for all."""
    everything = sum(found.values(), Counter[tuple[str, str]]())
    for noise, counts in [*sorted(found.items()), (None, everything)]:
        print(f"\n{'all noise' if noise is None else f'noise {noise:g}'}")
        print(f"  {'kind':30s} planted found false precision recall    F1")
        kinds = sorted({name.split("/")[1] for name, _ in counts if name.startswith("changed/")})
        for kind in kinds:
            print(f"  {kind:30s} {_figures(counts, [kind])}")
        print(f"  {'all':30s} {_figures(counts, kinds)}")
        lines = [kind for kind in kinds if kind not in _KINDS_OF_LIGHTS]
        print(f"  {'all but lights':30s} {_figures(counts, lines)}")
        false = sum(n for (name, what), n in counts.items() if what == "false" and "same/" in name)
        km = counts["same", "metres"] / 1000
        print(f"  same map: {false} false in {km:.2f} km, {false / max(km, 1e-9):.2f} a km")
        maps, right = counts["shifted", "maps"], counts["shifted", "right"]
        print(f"  shifted by {_SHIFT_M} m: {right} of {maps} maps give one global offset alone")


def _figures(counts: Counter[tuple[str, str]], kinds: list[str]) -> str:
    planted, found, false = (
        sum(counts[f"changed/{kind}", figure] for kind in kinds)
        for figure in ("planted", "found", "false")
    )
    precision = f"{found / (found + false):9.3f}" if found + false else "        -"
    recall = f"{found / planted:6.3f}" if planted else "     -"
    f1 = 2 * found / max(planted + found + false, 1)
    return f"{planted:7d} {found:5d} {false:5d} {precision} {recall} {f1:5.3f}"


if __name__ == "__main__":
    main()
