"""The data card: what a person must know of a data set before using it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import yaml

from percept.core.clock import iso_from_ns
from percept.core.rig import CameraSensor
from percept.core.whole_file import whole_file
from percept.datasets.labelling.card_gaps import known_gaps
from percept.datasets.labelling.card_markdown import bullets, markdown_table, marked, plain
from percept.datasets.labelling.labelled_set import SPLITS, LabelledSet
from percept.datasets.labelling.places.distances import least_distances

__all__ = ["write_card"]

_LICENCE = "not given: nobody but its owner may use this data set until one is"
_NOT_KNOWN = "not known"
_NO_BOXES = "There are no boxes."
_IMAGES = ("`images/`", "the images as they were recorded, blurred where the card says so")
_RECTIFIED = ("`rectified/`", "the same without lens distortion")
_SCANS = ("`scans/`", "LiDAR points: float32 x, y, z, intensity in the vehicle's frame")
_TABLES = (
    ("`frames.parquet`, `keyframes.parquet`", "the images, and the moments that they belong to"),
    ("`boxes_2d.parquet`, `boxes_3d.parquet`", "the boxes"),
    ("`dropped.parquet`", "the images that were left out, with the reason"),
    ("`report.html`", "pictures, a map and histograms"),
)


def write_card(
    labelled: LabelledSet,
    *,
    dropped: Mapping[str, int],
    losses: Mapping[str, Sequence[str]],
    settings: Mapping[str, object],
    margin_m: float | None = None,
    blurred: Mapping[str, int] | None = None,
    calibration: Mapping[str, str] | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the data card `README.md` into the folder of a set, whole.

    Args:
        labelled: The set.
        dropped: How many images were left out, by reason.
        losses: By format that was written, what it cannot hold, as from `export`.
        settings: The resolved configuration.
        margin_m: Least distance between splits that was asked for; None where nobody asked.
        blurred: How many regions were blurred, by kind.
        calibration: By drive, version of the calibration and what a check of it said.
        notes: What else a user should know.

    Raises:
        OSError: If the folder cannot be written.
    """
    sections = {
        "Contents": _contents(labelled),
        "Classes": _classes(labelled),
        "Logs": _logs(labelled),
        "Sensors": _sensors(labelled),
        "Calibration": _calibration(labelled, calibration or {}),
        "Where the boxes are from": _models(labelled),
        "Splits": _splits(labelled, margin_m),
        "Privacy": _privacy(labelled, blurred or {}),
        "What was left out": _left_out(dropped),
        "Files": _files(labelled, losses),
        "Known gaps": bullets(dict.fromkeys((*known_gaps(labelled), *notes))),
        "Licence": iter((plain(labelled.licence or _LICENCE),)),
        "Settings": _settings(settings),
    }
    lines = [f"# {plain(labelled.name)}", "", *_beginning(labelled)]
    for title, body in sections.items():
        lines += ["", f"## {title}", "", *body]
    with whole_file(labelled.folder / "README.md") as path:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _beginning(labelled: LabelledSet) -> Iterator[str]:
    images = sum(len(one.frames) for one in labelled.keyframes)
    made = f", made {plain(labelled.created)}" if labelled.created else ""
    boxes = any(len(frame.boxes) for _, frame in labelled.frames())
    begin = "boxes to begin labelling from" if boxes else "no boxes yet"
    yield (
        f"{images:,} images at {len(labelled.keyframes):,} moments of {len(labelled.drives):,} "
        f"drives, with {begin}{made} by `percept dataset prepare`."
    )
    yield "`percept dataset check` on this folder says whether it is still whole."


def _contents(labelled: LabelledSet) -> Iterator[str]:
    counts: dict[str, Counter[str]] = {
        name: Counter() for name in ("moments", "images", "scans", "boxes in images", "3D boxes")
    }
    for one in labelled.keyframes:
        counts["moments"][one.split] += 1
        counts["images"][one.split] += len(one.frames)
        counts["scans"][one.split] += one.scan is not None
        counts["boxes in images"][one.split] += sum(len(frame.boxes) for frame in one.frames)
        counts["3D boxes"][one.split] += len(one.solids)
    yield from _by_split("", counts)


def _classes(labelled: LabelledSet) -> Iterator[str]:
    if not labelled.categories:
        yield _NO_BOXES
        return
    yield "Their numbers in the formats follow this order. Boxes in images, and 3D boxes:"
    yield ""
    flat: dict[str, Counter[str]] = {label: Counter() for label in labelled.categories}
    solid: Counter[str] = Counter()
    for one in labelled.keyframes:
        solid.update(one.solids.labels)
        for frame in one.frames:
            for label in frame.boxes.labels:
                flat[label][one.split] += 1
    header = ("class", *SPLITS, "all", "3D boxes")
    yield from markdown_table(
        header,
        (
            (
                label,
                *(f"{row[split]:,}" for split in SPLITS),
                f"{row.total():,}",
                f"{solid[label]:,}",
            )
            for label, row in flat.items()
        ),
    )


def _logs(labelled: LabelledSet) -> Iterator[str]:
    rows = []
    for drive in labelled.drives.values():
        stamps = [one.stamp_ns for one in labelled.keyframes if one.drive == drive.name]
        first, last = (iso_from_ns(f(stamps)) if stamps else "-" for f in (min, max))
        row = (drive.name, drive.log, iso_from_ns(drive.start_ns), first, last, f"{len(stamps):,}")
        rows.append((*row, drive.fingerprint[:16]))
    header = ("drive", "log", "log begins", "first moment", "last moment", "moments", "fingerprint")
    yield from markdown_table(header, rows)


def _sensors(labelled: LabelledSet) -> Iterator[str]:
    taken = Counter((one.drive, frame.camera) for one, frame in labelled.frames())
    offsets: dict[tuple[str, str], int] = {}
    for one, frame in labelled.frames():
        key = one.drive, frame.camera
        offsets[key] = max(offsets.get(key, 0), abs(frame.offset_ns))
    rows = []
    for (of, name), count in taken.items():
        lens = _lens(labelled.drives[of].cameras.get(name))
        rows.append((of, name, *lens, f"{count:,}", f"{offsets[of, name] / 1e6:.1f}"))
    header = ("drive", "camera", "size, px", "lens", "placed", "images", "most offset, ms")
    yield from markdown_table(header, rows)
    yield ""
    lidars = {
        drive.name: f"{', '.join(drive.lidars) or 'none'}; vehicle frame {drive.base_frame}"
        for drive in labelled.drives.values()
    }
    yield from _by_drive(lidars, "LiDARs of ")


def _lens(camera: CameraSensor | None) -> tuple[str, str, str]:
    if camera is None:
        return "", _NOT_KNOWN, "no"
    width, height = camera.image_size
    return f"{width} x {height}", camera.model, "no" if camera.T_base_sensor is None else "yes"


def _calibration(labelled: LabelledSet, calibration: Mapping[str, str]) -> Iterator[str]:
    unknown = "version and verdict not known; see `percept calib check`"
    yield from _by_drive({name: calibration.get(name) or unknown for name in labelled.drives})


def _by_drive(said: Mapping[str, str], before: str = "") -> Iterator[str]:
    """Yield what is said of drives; what is said of several is said once."""
    names: dict[str, list[str]] = {}
    for name, text in said.items():
        names.setdefault(text, []).append(name)
    for text, alike in names.items():
        of = "all drives" if len(alike) == len(said) > 1 else ", ".join(alike)
        yield f"- {plain(before + of)}: {marked(text)}"


def _models(labelled: LabelledSet) -> Iterator[str]:
    counts: Counter[tuple[str, str]] = Counter()
    for one in labelled.keyframes:
        counts.update(("3D", source) for source in one.solids.sources)
        for frame in one.frames:
            counts.update(("images", source) for source in frame.boxes.sources)
    if not counts:
        yield _NO_BOXES
        return
    about: dict[str, set[str]] = {}
    for drive in labelled.drives.values():
        for source, known in drive.models.items():
            about.setdefault(source, set()).add(known)
    rows = (
        (place, source or "a person", f"{count:,}", "; ".join(sorted(about.get(source, ()))))
        for (place, source), count in sorted(counts.items())
    )
    yield from markdown_table(("boxes", "source", "number", "what is known of it"), rows)


def _splits(labelled: LabelledSet, margin_m: float | None) -> Iterator[str]:
    if margin_m is not None:
        yield f"- least distance between splits that was asked for: {margin_m:g} m"
    measured = least_distances(labelled)
    for (one, other), distance_m in measured.items():
        yield f"- least distance between {one} and {other}, measured: {distance_m:.1f} m"
    if not measured:
        yield "- no distance between splits could be measured"
    drives: Counter[str] = Counter()
    for name in labelled.drives:
        drives.update({one.split for one in labelled.keyframes if one.drive == name})
    held = ", ".join(f"{drives[split]:,} in {split}" for split in SPLITS)
    yield f"- drives with a moment in each split: {held}"


def _privacy(labelled: LabelledSet, blurred: Mapping[str, int]) -> Iterator[str]:
    if not labelled.anonymised:
        yield "Nothing was blurred."
        return
    yield (
        f"Blurred before anything was written: {', '.join(map(plain, labelled.anonymised))}. A "
        "network found them; it does not find all."
    )
    yield ""
    yield from bullets(f"{kind}: {count:,} regions" for kind, count in blurred.items())


def _left_out(dropped: Mapping[str, int]) -> Iterator[str]:
    if not dropped:
        yield "Nothing."
        return
    yield from markdown_table(
        ("reason", "images"), ((name, f"{n:,}") for name, n in dropped.items())
    )


def _files(labelled: LabelledSet, losses: Mapping[str, Sequence[str]]) -> Iterator[str]:
    rows = [_IMAGES]
    if any(frame.rectified_file not in (None, frame.file) for _, frame in labelled.frames()):
        rows.append(_RECTIFIED)
    if any(one.scan is not None for one in labelled.keyframes):
        rows.append(_SCANS)
    rows += _TABLES
    rows += [
        (f"`{name}/`", " ".join(("See its README.md.", *lost))) for name, lost in losses.items()
    ]
    yield from markdown_table(("what", "holds"), rows)


def _settings(settings: Mapping[str, object]) -> Iterator[str]:
    text = yaml.safe_dump(dict(settings), sort_keys=False, allow_unicode=True)
    yield "```yaml"
    yield text.replace("```", "'''").rstrip()
    yield "```"


def _by_split(name: str, rows: Mapping[str, Counter[str]]) -> Iterator[str]:
    header = (name, *SPLITS, "all")
    cells = (
        (row, *(f"{counts[split]:,}" for split in SPLITS), f"{counts.total():,}")
        for row, counts in rows.items()
    )
    return markdown_table(header, cells)
