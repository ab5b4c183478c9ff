"""Traffic lights, and the health of sensors and detectors, as rerun draws them over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from percept.core.results import LightStates
from percept.export.canvas import Rgb
from percept.export.light_states import LIGHT_COLOURS, shown_state
from percept.export.view.stream import ViewStream

__all__ = ["LightDrawing", "LightFace", "state_colours"]


class LightFace(Protocol):
    """A traffic light of a map, as `percept.hdmap` has it."""

    @property
    def light_id(self) -> int:
        """Its id in the map."""

    @property
    def corners_map(self) -> NDArray[np.float64]:
        """(4, 3) corners of its face, metres: around it in order."""


class LightDrawing:
    """Draws traffic lights into a view: a lane of states for each, and its face where it hangs.

    Args:
        stream: The view.
    """

    legend = (
        "Lights: a lane for each with its state over time; 'not seen' where no camera saw it, "
        "'dark' where its housing was seen and no lamp shone."
    )

    def __init__(self, stream: ViewStream) -> None:
        self._stream = stream
        self._faces: dict[int, NDArray[np.float64]] = {}
        self._shown: dict[int, str] = {}

    def add(self, lights: LightStates, faces: Sequence[LightFace], frame_id: str | None) -> None:
        """Draw the lights of a moment. Moments come in order of time.

        Args:
            lights: Their states.
            faces: Where they hang, as far as that is known and was not given before.
            frame_id: Frame of the faces; None where they cannot be placed.
        """
        self._faces.update({face.light_id: face.corners_map for face in faces})
        states = {int(i): shown_state(lights, row) for row, i in enumerate(lights.ids)}
        gone = dict.fromkeys(self._shown, "")  # one that is gone leaves a gap in its lane
        changed = {i: s for i, s in (gone | states).items() if self._shown.get(i, "") != s}
        for light_id, state in sorted(changed.items()):
            at = rr.new_entity_path(["states", "lights", str(light_id)])
            if light_id not in self._shown:
                self._stream.log(at, state_colours(LIGHT_COLOURS), static=True)
            self._stream.log(at, rr.StateChange(state=state))
        if changed and frame_id is not None:
            self._draw_faces(self._stream.entity_in(frame_id, "lights"), states)
        self._shown = gone | states

    def _draw_faces(self, at: str, states: Mapping[int, str]) -> None:
        placed = [light_id for light_id in states if light_id in self._faces]
        corners = [self._faces[light_id] for light_id in placed]
        colours = [LIGHT_COLOURS[states[light_id]] for light_id in placed]
        outlines = rr.LineStrips3D(
            [np.vstack([face, face[:1]]) for face in corners],
            colors=colours,
            radii=rr.Radius.ui_points(2.0),
            labels=[f"{light_id} {states[light_id]}" for light_id in placed],
            show_labels=True,
        )
        self._stream.log(f"{at}/outlines", outlines)
        self._stream.log(f"{at}/faces", _filled(corners, colours))


def state_colours(colours: Mapping[str, Rgb]) -> rr.StateConfiguration:
    """Return the colours of the states of a lane, by state."""
    return rr.StateConfiguration(values=list(colours), colors=[*colours.values()])


def _filled(corners: Sequence[NDArray[np.float64]], colours: Sequence[Rgb]) -> rr.AsComponents:
    """Return faces (4, 3) as a mesh of two triangles each."""
    if not corners:
        return rr.Clear(recursive=False)
    firsts = 4 * np.arange(len(corners))[:, None, None]
    return rr.Mesh3D(
        vertex_positions=np.concatenate(corners),
        triangle_indices=(firsts + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3),
        vertex_colors=np.repeat(np.array(colours, dtype=np.uint8), 4, axis=0),
    )
