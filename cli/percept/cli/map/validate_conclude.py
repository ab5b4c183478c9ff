"""The end of a run of `percept map validate`: tables, report, verdict and `run.json`."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from percept.cli.map.drive import DriveFacts
from percept.cli.map.evidence import FOLDER
from percept.cli.map.validate_request import MapValidateConfig, MapValidateRequest
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.map_findings import Discrepancy, Kind, Status
from percept.core.results import Verdict
from percept.export.coverage_table import COVERAGE, OFFSETS, coverage_rows, offset_rows
from percept.export.discrepancy_geojson import write_discrepancies_geojson
from percept.export.discrepancy_table import DISCREPANCIES, degrees_of, discrepancy_rows
from percept.export.map_lines import write_map_lines
from percept.export.map_report import MapEvidence, map_report
from percept.export.report import write_report
from percept.export.tables import write_parquet
from percept.hdmap import HdMap
from percept.hdmap.validate import Validation
from percept.lights.map_check import LightFindings

__all__ = ["OUTPUTS", "MapResult", "conclude"]

OUTPUTS = (
    "discrepancies.parquet", "discrepancies.geojson", "coverage.parquet", "offsets.parquet",
    "map_lines.json", "report.html", "view.rrd", FOLDER,
)  # fmt: skip
"""What a run writes, but for `run.json`."""

_MOST_OFFSETS = 60


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapResult:
    """What a run found.

    Attributes:
        request: What was asked for.
        config: Settings.
        hd_map: The map.
        drives: The drives.
        validation: What the lines say.
        lights: What the lights say.
        findings: All findings that are reported, the surest first.
        evidence: By finding's id, its picture relative to the run folder.
        dropped: What was left out of the logs, by reason.
        notes: What a user should know besides, as sentences.
    """

    request: MapValidateRequest
    config: MapValidateConfig
    hd_map: HdMap
    drives: Sequence[DriveFacts]
    validation: Validation
    lights: LightFindings
    findings: Sequence[Discrepancy]
    evidence: Mapping[str, str]
    dropped: Counter[str]
    notes: Sequence[str] = ()

    @property
    def way_m(self) -> float:
        """Metres that the vehicle went in all drives."""
        return sum(drive.poses.length_m for drive in self.drives)


def conclude(folder: RunFolder, result: MapResult) -> dict[str, Any]:
    """Write everything, and return the content of `run.json`."""
    path, findings, validation = folder.path, result.findings, result.validation
    georeference = result.hd_map.georeference
    geodetic = None if georeference is None else georeference.geodetic
    rows = discrepancy_rows(findings, result.evidence, degrees_of(findings, geodetic))
    write_parquet(path / "discrepancies.parquet", DISCREPANCIES, [rows])
    write_discrepancies_geojson(path / "discrepancies.geojson", findings, result.evidence, geodetic)
    write_parquet(path / "coverage.parquet", COVERAGE, [coverage_rows(validation.coverage)])
    write_parquet(path / "offsets.parquet", OFFSETS, [offset_rows(validation.offsets)])
    ways = [drive.poses for drive in result.drives]
    write_map_lines(path / "map_lines.json", result.hd_map.markings, ways)
    verdict, why = _judge(result)
    notes = _notes(result)
    dropped = _dropped(result)
    inputs = [
        *(file for drive in result.drives for file in drive.files),
        result.request.map_file,
        *(path for path in (result.request.rig, result.request.config) if path is not None),
        *result.request.reviews,
    ]
    counts = _counts(result)
    report = map_report(
        MapEvidence(
            map_name=result.request.map_file.name,
            findings=findings,
            pictures={i: path / name for i, name in result.evidence.items()},
            facts=_facts(counts),
            not_seen_m=_not_seen(validation),
            seen_m=counts["seen_m"],
            offsets=_offsets(validation),
            dropped=dropped,
            notes=notes,
            inputs=[describe_input(file) for file in inputs],
        ),
        verdict=verdict,
        why=why,
        advice=_advice(result),
    )
    write_report(path / "report.html", report)
    return folder.finish(
        config={
            **result.config.model_dump(mode="json"),
            "poses": [drive.found.source for drive in result.drives],
            "cameras": [[c.name for c in drive.cameras.values()] for drive in result.drives],
        },
        inputs=inputs,
        counts=counts,
        dropped=dropped,
        verdict=verdict,
        why=why,
        notes=notes,
    )


def _judge(result: MapResult) -> tuple[Verdict, list[str]]:
    """Return the verdict of the comparison, which poses can only make worse."""
    verdict, why = result.validation.verdict, [result.validation.why]
    for drive in result.drives:
        if drive.found.verdict is not Verdict.GOOD:
            why += [f"poses of {drive.name}: {reason}" for reason in drive.found.why]
            verdict = Verdict.DOUBTFUL if verdict is Verdict.GOOD else verdict
    return verdict, why


def _notes(result: MapResult) -> list[str]:
    notes = [f"{drive.name}: {note}" for drive in result.drives for note in drive.notes]
    return [*notes, *result.validation.notes, *result.lights.notes, *result.notes]


def _dropped(result: MapResult) -> dict[str, int]:
    named = {f"lights: {reason}": n for reason, n in result.lights.dropped.items()}
    maps = {f"map: {reason}": n for reason, n in result.hd_map.dropped.items()}
    return {**(result.dropped + result.validation.dropped), **named, **maps}


def _counts(result: MapResult) -> dict[str, Any]:
    validation = result.validation
    kinds = Counter(str(finding.kind) for finding in result.findings)
    statuses = Counter(str(finding.status) for finding in result.findings)
    seen_m = sum(c.observed_share * c.length_m for c in validation.coverage)
    lights = [looks for looks in result.lights.looks.values() if looks]
    return {
        "drives": len(result.drives),
        "way_m": round(result.way_m, 2),
        "findings": len(result.findings),
        "kinds": {str(kind): kinds[kind] for kind in Kind if kinds[kind]},
        "statuses": {str(status): statuses[status] for status in Status if statuses[status]},
        "seen_m": round(seen_m, 1),
        "not_seen_m": {reason: round(m, 1) for reason, m in _not_seen(validation).items()},
        "lights_seen": len(lights),
        "pictures": len(result.evidence),
        **validation.counts,
    }


def _not_seen(validation: Validation) -> dict[str, float]:
    metres: defaultdict[str, float] = defaultdict(float)
    for stretch in validation.coverage:
        missing_m = (1 - stretch.observed_share) * stretch.length_m
        if missing_m > 0:
            metres[stretch.reason or "seen too seldom"] += missing_m
    return dict(sorted(metres.items(), key=lambda one: -one[1]))


def _facts(counts: Mapping[str, Any]) -> dict[str, str]:
    facts = {
        "drives": str(counts["drives"]),
        "way": f"{counts['way_m'] / 1000:.2f} km",
        "findings": str(counts["findings"]),
        "traffic lights in view": str(counts["lights_seen"]),
    }
    plain = {k: v for k, v in counts.items() if isinstance(v, int) and k not in facts}
    left = ("drives", "findings", "lights_seen", "pictures")
    return facts | {k.replace("_", " "): str(v) for k, v in plain.items() if k not in left}


def _offsets(validation: Validation) -> list[dict[str, str]]:
    offsets = [offset for offset in validation.offsets if offset.lines > 0]
    every = max(1, len(offsets) // _MOST_OFFSETS)
    return [
        {
            "drive": str(offset.drive),
            "at (m)": f"{offset.along_m:.0f}",
            "to the left (m)": f"{offset.lateral_m:+.3f}",
            "sd (m)": f"{offset.sd_m:.3f}",
            "turned left (deg)": f"{offset.heading_rad * 57.29578:+.2f}",
            "lines": f"{offset.lines:.1f}",
            "ambiguous": "yes" if offset.ambiguous else "",
        }
        for offset in offsets[::every]
    ]


def _advice(result: MapResult) -> list[str]:
    advice = []
    open_ones = [f for f in result.findings if f.status is Status.OPEN]
    if any(finding.kind is Kind.GLOBAL_OFFSET for finding in open_ones):
        advice.append("Look at the offset first: check --origin, the projector and the calibration")
    if open_ones:
        advice.append(f"Decide the {len(open_ones)} open findings: `percept map review RUN`")
    if result.validation.verdict not in (Verdict.GOOD, Verdict.DOUBTFUL):
        advice.append("Drive the road again, or give another log: too little of the map was seen")
    return advice
