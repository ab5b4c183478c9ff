"""`percept map check`: what is wrong with a map by itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.map.options import OriginOption
from percept.cli.options import JsonOption
from percept.core.errors import InputError, UsageError

__all__ = ["check"]

_ISSUES_FOUND = 4


def check(
    map_file: Annotated[
        Path | None, typer.Argument(metavar="MAP", help="A Lanelet2 map.", show_default=False)
    ] = None,
    *,
    rule: Annotated[
        list[str] | None,
        typer.Option(
            "--rule",
            metavar="NAME",
            help="Hold the map to this rule only, such as mapping.lane.border_sharing. Repeat it "
            "for several.",
        ),
    ] = None,
    origin: OriginOption = None,
    list_rules: Annotated[
        bool, typer.Option("--list-rules", help="Say which rules there are, and check nothing.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Hold a Lanelet2 map to rules that it can break by itself; no log is needed.

    Says what is wrong, at which lanelet, line string, point or regulatory element, and what to
    do. Names and numbers of the rules are those of Autoware's map validator. Ends with 4 when
    there is an issue.

    Example: percept demo --out demo && percept map check demo/map.osm
    """
    from percept.cli.map.check_show import issues_document, rules_document, show_issues, show_rules

    if list_rules:
        if as_json:
            typer.echo(json.dumps(rules_document(), indent=2))
        else:
            show_rules()
        return
    if map_file is None:
        raise UsageError("no map is given", remedy="Name one: percept map check MAP")
    from percept.cli.track.maps import named_place
    from percept.hdmap import load_map
    from percept.hdmap.check import check_map, rules_named
    from percept.hdmap.opendrive import is_opendrive

    if is_opendrive(map_file):
        raise InputError("is OpenDRIVE; the rules are for Lanelet2 maps", where=map_file)
    names = tuple(one.name for one in rules_named(rule))
    hd_map = load_map(map_file, named_place(origin), anywhere=True)
    issues = check_map(hd_map, names)
    if as_json:
        typer.echo(json.dumps(issues_document(issues), indent=2))
    else:
        show_issues(hd_map, names, issues)
    raise typer.Exit(_ISSUES_FOUND if issues else 0)
