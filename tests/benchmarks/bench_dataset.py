"""Time of `percept dataset prepare` against a plain script that decodes images and writes them.

Both get the same log and write the same images; the script, as anybody would write it in an hour,
does nothing else. Both times include the start of the program. Without a log it is a synthetic
drive, once as it is (640x400) and once with its images enlarged to 1600x1000, as real ones are.
Run it with `.venv/bin/python tests/benchmarks/bench_dataset.py [LOG]`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

_ROUNDS = 5
_SECONDS = 20
_PLAIN = """
import sys
from pathlib import Path
import cv2, numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

out = Path(sys.argv[2])
out.mkdir()
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, _, _, message in reader.iter_decoded_messages(topics=sys.argv[3:]):
        image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
        stamp = message.header.stamp
        cv2.imwrite(str(out / f"{stamp.sec}{stamp.nanosec:09d}.jpg"), image)
"""
_SETTINGS = """
keyframes: {every_s: 0.01, distance_m: 0.01, min_gap_s: 0.0}
selection: {duplicates: null, quality: {least_sharpness: 0.0, least_relative_sharpness: 0.0}}
split: {train: 1.0, val: 0.0, test: 0.0}
"""


def main() -> None:
    """Compare both on the log that was given, or on made ones."""
    with tempfile.TemporaryDirectory() as scratch:
        if len(sys.argv) > 1:
            _compare(Path(sys.argv[1]))
            return
        made = _made(Path(scratch))
        for log in (made, _enlarged(made, Path(scratch) / "large.mcap")):
            _compare(log)


def _compare(log: Path) -> None:
    """Print the ratio of the medians, and the times."""
    print(log.name)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "all.yaml").write_text(_SETTINGS)
        topics = _image_topics(log)
        times: dict[str, list[float]] = {"plain": [], "percept": []}
        for number in range(_ROUNDS):
            plain = [sys.executable, "-c", _PLAIN, str(log), str(folder / f"p{number}"), *topics]
            ours = [
                sys.executable, "-m", "percept.cli", "dataset", "prepare", "--bag", str(log),
                "--config", str(folder / "all.yaml"), "--format", "coco", "--out",
                str(folder / f"s{number}"),
            ]  # fmt: skip
            for name, command in (("plain", plain), ("percept", ours)):
                begun = time.perf_counter()
                subprocess.run(command, check=True, capture_output=True)
                times[name].append(time.perf_counter() - begun)
        images = len(list((folder / "p0").iterdir()))
        written = len(list((folder / "s0/images").iterdir()))
    print(f"{images} images of the script, {written} of percept")
    for name, seconds in times.items():
        middle = sorted(seconds)[_ROUNDS // 2]
        print(f"{name}: {images / middle:.0f} images a second ({middle:.2f} s)")
    ratios = sorted(o / p for o, p in zip(times["percept"], times["plain"], strict=True))
    print(f"time of percept over that of the script: {ratios[_ROUNDS // 2]:.2f} (at most 1.3)")
    print(f"  of each pair: {', '.join(f'{ratio:.2f}' for ratio in ratios)}")


def _made(folder: Path) -> Path:
    made = folder / "made"
    command = ["synth", "drive", "--seconds", str(_SECONDS), "--out", str(made)]
    subprocess.run([sys.executable, "-m", "percept.cli", *command], check=True, capture_output=True)
    return made / "drive.mcap"


def _enlarged(log: Path, path: Path) -> Path:
    import cv2

    from percept.core.samples import CameraImage, GnssFix
    from percept.datasets import open_recording
    from percept.datasets.write import LogWriter

    with open_recording(log) as recording, LogWriter(path, "mcap", images="jpeg") as large:
        kinds = (CameraImage, GnssFix)
        topics = [t.topic for t in recording.topics() if t.sample_type in kinds]
        for sample in recording.samples(topics=topics):
            if isinstance(sample, CameraImage):
                pixels = cv2.resize(sample.pixels, (1600, 1000))
                sample = replace(sample, pixels=pixels, file=None)
            large.write(sample)
    return path


def _image_topics(log: Path) -> list[str]:
    from percept.core.samples import CameraImage
    from percept.datasets import open_recording

    with open_recording(log) as recording:
        return [t.topic for t in recording.topics() if t.sample_type is CameraImage]


if __name__ == "__main__":
    main()
