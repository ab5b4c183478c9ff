"""The run behind `percept dataset prepare`: from logs to a folder that is whole.

Everything is made in a hidden folder in `--out`, and moved out of it at the end.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from percept.cli.dataset.assemble import Assembled, assemble
from percept.cli.dataset.collect import Collector
from percept.cli.dataset.conclude import Prepared, conclude
from percept.cli.dataset.drives import DrivePlan, LogSource, find_sources, open_source, plan_drive
from percept.cli.dataset.journal import PLAN_NAME, Journal
from percept.cli.dataset.place import PlacedMoment, place_moments
from percept.cli.dataset.request import PrepareConfig, PrepareRequest
from percept.cli.dataset.write_formats import write_formats
from percept.cli.interrupts import deferred_interrupt
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import InputError, InsufficientDataError, UsageError
from percept.core.rig import load_rig
from percept.core.settings import load_settings
from percept.datasets.labelling.dropped import write_dropped
from percept.datasets.labelling.formats import EXPORTERS
from percept.datasets.labelling.images.image_files import ImageWriter
from percept.datasets.labelling.labelled_set import Drive, LabelledSet
from percept.datasets.labelling.set_tables import write_set

if TYPE_CHECKING:
    from percept.datasets.labelling.images.anonymise import Anonymiser
    from percept.detection.regions import RegionModel

__all__ = ["run_preparation"]

_STAGING = ".unfinished"
_OUTPUTS = (
    _STAGING, "README.md", "boxes_2d.parquet", "boxes_3d.parquet", "dataset.json",
    "dropped.parquet", "frames.parquet", "images", "keyframes.parquet", "rectified",
    "report.html", "scans", *EXPORTERS,
)  # fmt: skip
_NEED_PNG = ("kitti", "kitti-tracking")


def run_preparation(request: PrepareRequest) -> dict[str, Any]:
    """Prepare a data set; return the content of `run.json`.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    if not request.bags and not request.runs:
        raise UsageError("no log was given", remedy="Give --bag LOG or --run RUN")
    config = load_settings(PrepareConfig, request.config, request.flags)
    with (
        deferred_interrupt() as check,
        RunFolder(
            request.out, force=request.force, resume=request.resume, outputs=_OUTPUTS
        ) as folder,
    ):
        return _Preparation(request, config, check).fill(folder)


class _Preparation:
    """One preparation, step by step."""

    def __init__(
        self, request: PrepareRequest, config: PrepareConfig, check: Callable[[], None]
    ) -> None:
        self._request = request
        self._config = config
        self._check = check
        self._rig = load_rig(request.rig) if request.rig is not None else None
        # The networks are loaded only where they are asked for.
        self._anonymiser: Anonymiser | None = None
        self._finders: Mapping[str, RegionModel] = {}
        if request.anonymise or request.anonymise_models:
            from percept.cli.dataset.anonymise_models import anonymiser_of

            self._anonymiser, self._finders = anonymiser_of(
                request.anonymise, request.anonymise_models
            )
        self._with_scans = any(EXPORTERS[name].points for name in request.formats)
        self._staging = request.out / _STAGING

    def fill(self, folder: RunFolder) -> dict[str, Any]:
        """Do all of it."""
        self._make_room()
        sources = find_sources(self._request)
        plans = self._plans(sources)
        inputs = self._inputs(plans)
        folder.begin(inputs)
        self._staging.mkdir(exist_ok=True)
        left, placed = place_moments(plans, self._config)
        drives = {plan.name: _drive(plan) for plan in plans}
        with ExitStack() as stack:
            journal = stack.enter_context(Journal(self._staging, self._plan_entry(plans)))
            self._collect(left, journal)
            assembled = self._assembled(placed, journal, drives)
            blurred = _blurred(journal, assembled)
            read_failures = _scan_failures(journal)
        labelled = self._labelled(assembled, drives)
        write_set(labelled)
        write_dropped(self._staging, assembled.dropped)
        written = write_formats(labelled, self._request.formats, self._check)
        return conclude(
            folder,
            Prepared(
                request=self._request,
                config=self._config,
                plans=plans,
                labelled=labelled,
                assembled=assembled,
                written=written,
                inputs=inputs,
                blurred=blurred,
                losses=sum(
                    (plan.losses for plan in plans),
                    assembled.unlabelled + read_failures,
                ),
                notes=[f"{kind}: {model.note}." for kind, model in self._finders.items()],
            ),
        )

    def _make_room(self) -> None:
        """See to it that `--resume` finds what this command left, whole, or nothing of it.

        Raises:
            UsageError: If somebody else's files stand where the outputs would go.
        """
        if not self._request.resume or (self._staging / PLAN_NAME).is_file():
            return
        there = [name for name in _OUTPUTS if (self._request.out / name).exists()]
        if there and not self._staging.is_dir():
            raise UsageError(
                f"holds no interrupted preparation, but {', '.join(there[:3])}",
                where=self._request.out,
                remedy="Give another --out, or --force without --resume to write over them",
            )
        for name in there:  # ended while it was moving its files to their places
            path = self._request.out / name
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()

    def _plans(self, sources: Sequence[LogSource]) -> list[DrivePlan]:
        """Settle all logs, in the order of their start, under names that differ."""
        plans: list[DrivePlan] = []
        for source in sorted(sources, key=_start_ns):  # of equals the first that was given
            with open_source(source) as recording:
                plan = plan_drive(
                    recording,
                    source,
                    self._rig,
                    self._config,
                    self._request,
                    self._check,
                    with_scans=self._with_scans,
                    earlier=plans,
                )
                if not plan.streams and not plan.lidars:
                    raise InputError(
                        "holds neither images nor scans of a LiDAR of known place"
                        if self._with_scans
                        else "has no images, and --format names none that holds scans alone",
                        where=source.paths[0],
                        remedy="Look with `percept inspect`; --rig says where a LiDAR sits"
                        if self._with_scans
                        else "Add --format sustech or another one with points",
                    )
                plans.append(plan)
            self._check()
        if not any(plan.moments for plan in plans):
            lost = sum((plan.losses for plan in plans), Counter[str]())
            reasons = ", ".join(f"{count} x {why}" for why, count in lost.items())
            raise InsufficientDataError(
                "there is no image and no scan to choose from" + (reasons and f" ({reasons})"),
                where=sources[0].paths[0],
                remedy="Choose another --topic, --start or --end, or look with `percept inspect`",
            )
        space = all(EXPORTERS[name].solid for name in self._request.formats)
        if space and not any(plan.lidars for plan in plans):
            raise InputError(
                f"{', '.join(self._request.formats)} cannot be written without LiDAR scans, and no "
                "log has a LiDAR of known place",
                where=sources[0].paths[0],
                remedy="Find its place with `percept calib lidar` and give it with --rig",
            )
        seen: Counter[str] = Counter()
        named = []
        for plan in plans:
            seen[plan.name] += 1
            number = seen[plan.name]
            named.append(plan if number == 1 else replace(plan, name=f"{plan.name}-{number}"))
        return named

    def _inputs(self, plans: Sequence[DrivePlan]) -> list[Path]:
        files = [path for plan in plans for path in plan.files if path.is_file()]
        for plan in plans:
            if plan.source.run is not None:
                files += sorted(plan.source.run.folder.glob("*.parquet"))
                files += [plan.source.run.folder / name for name in ("run.json", "rig.yaml")]
        given = (self._request.rig, self._request.config)
        models = [model.path for model in self._finders.values()]
        return [*files, *(path for path in given if path is not None), *models]

    def _plan_entry(self, plans: Sequence[DrivePlan]) -> dict[str, Any]:
        """Return what a preparation must have in common with the one that it goes on with."""
        request = self._request
        return {
            "settings": self._config.model_dump(mode="json"),
            "drives": [[plan.name, plan.fingerprint] for plan in plans],
            "cameras": [{t: s.name for t, s in plan.streams.items()} for plan in plans],
            "moments": [len(plan.moments) for plan in plans],
            "scans": self._with_scans,
            "rectified": self._suffix(),
            "anonymise": {kind: model.sha256 for kind, model in self._finders.items()},
            "rig": None if request.rig is None else describe_input(request.rig)["sha256_head"],
        }

    def _suffix(self) -> str | None:
        """Return the suffix of images without distortion; None where no format needs them."""
        formats = self._request.formats
        if not any(EXPORTERS[name].rectified for name in formats):
            return None
        return ".png" if set(formats) & set(_NEED_PNG) else ".jpg"

    def _collect(self, plans: Sequence[DrivePlan], journal: Journal) -> None:
        writer = ImageWriter(
            self._staging,
            self._config.images,
            rectified_suffix=self._suffix(),
            anonymiser=self._anonymiser,
        )
        collectors = [
            Collector(self._staging, plan, writer, journal, with_scans=self._with_scans)
            for plan in plans
        ]
        before = 0
        with progress_bar("reading images and scans", sum(map(len, collectors))) as advance:
            for plan, collector in zip(plans, collectors, strict=True):
                total = len(collector)

                def on_done(done: int, before: int = before) -> None:
                    advance(before + done)
                    self._check()

                with open_source(plan.source) as recording:
                    collector.run(recording, on_done)
                before += total

    def _assembled(
        self, placed: Sequence[PlacedMoment], journal: Journal, drives: Mapping[str, Drive]
    ) -> Assembled:
        done = 0
        with progress_bar("linking boxes", len(placed)) as advance:

            def on_keyframe() -> None:
                nonlocal done
                done += 1
                advance(done)
                self._check()

            return assemble(
                self._staging,
                placed,
                journal,
                drives,
                self._config,
                self._request.budget,
                on_keyframe,
            )

    def _labelled(self, assembled: Assembled, drives: Mapping[str, Drive]) -> LabelledSet:
        labels: dict[str, None] = {}
        for keyframe in assembled.keyframes:
            labels |= dict.fromkeys(keyframe.solids.labels)
            for frame in keyframe.frames:
                labels |= dict.fromkeys(frame.boxes.labels)
        return LabelledSet(
            folder=self._staging,
            name=self._request.out.resolve().name,
            categories=tuple(sorted(labels)),
            drives=dict(drives),
            keyframes=tuple(assembled.keyframes),
            licence=self._request.licence,
            anonymised=self._request.anonymise,
            created=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        )


def _start_ns(source: LogSource) -> int:
    with open_source(source) as recording:
        return recording.start_ns or 0


def _drive(plan: DrivePlan) -> Drive:
    return Drive(
        name=plan.name,
        log=plan.log,
        fingerprint=plan.fingerprint,
        start_ns=plan.start_ns,
        base_frame=plan.base_frame,
        cameras={lens.name: lens for lens in plan.lenses.values()},
        lidars=tuple(lidar.name for lidar in plan.lidars.values()),
        models={} if plan.source.run is None else dict(plan.source.run.models),
    )


def _blurred(journal: Journal, assembled: Assembled) -> dict[str, int]:
    """Return how many regions were blurred in the images of the set, by kind."""
    kept = {frame.file for keyframe in assembled.keyframes for frame in keyframe.frames}
    counts: Counter[str] = Counter()
    for image in journal.images.values():
        if image.written is not None and image.written.file in kept:
            counts.update(image.written.blurred)
    return dict(counts)


def _scan_failures(journal: Journal) -> Counter[str]:
    """Return how many scans of keyframes could not be used, by reason."""
    counts: Counter[str] = Counter()
    for scan in journal.scans.values():
        counts.update(scan.failures)
    return counts
