"""The board in images and clouds of pairs, for `calib camera-lidar` and `calib check`."""

from __future__ import annotations

from collections.abc import Sequence

from percept.calib.board_in_cloud.find import (
    BoardInCloud,
    BoardInCloudConfig,
    NoBoardInCloud,
    find_boards,
)
from percept.calib.boards.definitions import Board, load_board
from percept.calib.boards.detection import detect_board
from percept.calib.boards.views import BoardView, NoBoard
from percept.calib.camera_lidar.calibrate import BoardPair
from percept.calib.camera_lidar.pairs import check_plate
from percept.cli.calib.camera_lidar_inputs import Shot
from percept.cli.progress import progress_bar
from percept.core.cameras import Camera
from percept.core.errors import DecodeError, InputError, UsageError

__all__ = ["board_and_plate", "find_board_pairs"]


def board_and_plate(board: str, board_size: str | None) -> tuple[Board, tuple[float, float]]:
    """Return the board and the size of its plate, (width, height) in metres.

    Args:
        board: `--board`.
        board_size: `--board-size`, or None.

    Raises:
        UsageError: If one of them is not of its form, or the pattern does not fit on the plate.
    """
    definition = load_board(board)
    size_m = definition.plate_size_m
    if board_size is not None:
        size_m = _size(board_size)
    if size_m is None:
        raise UsageError(
            "the outer size of the board is not known, and the LiDAR sees nothing else of it",
            remedy="Give --board-size WxH in metres",
        )
    check_plate(definition.board.corners_board(), size_m)
    return definition.board, size_m


def _size(text: str) -> tuple[float, float]:
    try:
        width, height = (float(side) for side in text.lower().split("x"))
    except ValueError as error:
        raise UsageError(
            f"--board-size '{text}' is not of the form WxH", remedy="Write 0.85x0.61, in metres"
        ) from error
    return width, height


def find_board_pairs(
    shots: Sequence[Shot],
    camera: Camera,
    board: Board,
    plate_size_m: tuple[float, float],
    config: BoardInCloudConfig,
) -> list[BoardPair]:
    """Find the board in every image and cloud; what is missing has a reason.

    Args:
        shots: Images and clouds.
        camera: The camera's intrinsics.
        board: What is printed on the board.
        plate_size_m: (width, height) of the plate.
        config: How it is found in clouds.
    """
    with progress_bar("the board in images", len(shots)) as advance:
        views: list[BoardView | NoBoard] = []
        for shot in shots:
            views.append(_view(shot, camera, board))
            advance(len(views))
    with progress_bar("the board in clouds", len(shots)) as advance:
        boards = find_boards(
            [shot.points for shot in shots],
            [shot.name for shot in shots],
            plate_size_m,
            config,
            advance,
        )
    return [
        _pair(shot.name, view, found)
        for shot, view, found in zip(shots, views, boards, strict=True)
    ]


def _view(shot: Shot, camera: Camera, board: Board) -> BoardView | NoBoard:
    try:
        pixels = shot.read_image()
    except (DecodeError, InputError) as error:
        return NoBoard(shot.name, f"the image cannot be read ({error})")
    size = (pixels.shape[1], pixels.shape[0])
    if size != camera.image_size:
        expected = f"{camera.image_size[0]}x{camera.image_size[1]}"
        return NoBoard(shot.name, f"the image is {size[0]}x{size[1]}, the intrinsics {expected}")
    return detect_board(pixels, board, name=shot.name)


def _pair(name: str, view: BoardView | NoBoard, board: BoardInCloud | NoBoardInCloud) -> BoardPair:
    reasons = []
    if isinstance(view, NoBoard):
        reasons.append(f"image: {view.reason}")
    if isinstance(board, NoBoardInCloud):
        reasons.append(f"cloud: {board.reason}")
    return BoardPair(
        name,
        None if isinstance(view, NoBoard) else view,
        None if isinstance(board, NoBoardInCloud) else board,
        tuple(reasons),
    )
