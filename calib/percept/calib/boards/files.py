"""Board files: percept's own (`board`, `board_size`) and Kalibr's target files, both YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field
from pydantic.alias_generators import to_camel

from percept.core.errors import ConfigError
from percept.core.settings import Settings, load_yaml_mapping, parse_settings

__all__ = ["read_board_file"]


class _BoardFile(Settings):
    board: str
    board_size: str | None = None


class _KalibrAprilGrid(Settings):
    """As https://github.com/ethz-asl/kalibr/wiki/calibration-targets writes it."""

    model_config = ConfigDict(alias_generator=to_camel)

    target_type: Literal["aprilgrid"] = Field(alias="target_type")
    tag_cols: int
    tag_rows: int
    tag_size: float
    tag_spacing: float


class _KalibrCheckerboard(Settings):
    """`targetCols` and `targetRows` count inner corners."""

    model_config = ConfigDict(alias_generator=to_camel)

    target_type: Literal["checkerboard"] = Field(alias="target_type")
    target_cols: int
    target_rows: int
    row_spacing_meters: float
    col_spacing_meters: float


def read_board_file(path: Path) -> tuple[str, str | None]:
    """Read a board file.

    Returns:
        The board as it is written on the command line, such as `checkerboard:9x6:0.025`, and the
        size of its plate as `WIDTHxHEIGHT` in metres, or None.

    Raises:
        ConfigError: If the file cannot be read, or is neither kind of board file.
    """
    values = load_yaml_mapping(path)
    if "target_type" in values:
        return _kalibr_text(values, path), None
    found = parse_settings(_BoardFile, values, where=path)
    return found.board, found.board_size


def _kalibr_text(values: dict[str, Any], path: Path) -> str:
    kind = values["target_type"]
    if kind == "aprilgrid":
        grid = parse_settings(_KalibrAprilGrid, values, where=path)
        return f"aprilgrid:{grid.tag_cols}x{grid.tag_rows}:{grid.tag_size}:{grid.tag_spacing}"
    if kind != "checkerboard":
        raise ConfigError(
            f"target_type '{kind}' is not supported",
            where=path,
            remedy="Use a checkerboard or an aprilgrid",
        )
    board = parse_settings(_KalibrCheckerboard, values, where=path)
    if board.row_spacing_meters != board.col_spacing_meters:
        raise ConfigError(
            f"its fields are {board.col_spacing_meters:g} x {board.row_spacing_meters:g} m",
            where=path,
            remedy="Use a checkerboard of squares",
        )
    return f"checkerboard:{board.target_cols}x{board.target_rows}:{board.col_spacing_meters}"
