"""Raw messages become samples, by the definitions that their log carries."""

from __future__ import annotations

import contextlib
import struct
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from percept.core.clock import NS_PER_S
from percept.core.errors import DecodeError, GeometryError
from percept.core.samples import OtherSample, Sample
from percept.datasets.decoding.message_samples import CONVERTERS, head_of
from percept.datasets.decoding.typestores import DefinitionCatalog, matches_standard
from percept.datasets.messages import Connection, RawMessage, RosMessage

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc
    from rosbags.typesys.store import Typestore

__all__ = ["Decoder"]

_HEADER = "std_msgs/msg/Header"
_TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_CDR_ENCAPSULATION_BYTES = 4
_UNFIT = (SerdeError, KeyError, IndexError, RecursionError, MemoryError, OverflowError)


class Decoder:
    """Decodes the messages of one log.

    Args:
        connections: The topics of the log.

    Attributes:
        undecodable: Why a topic's messages, or those of one of its publishers, cannot be decoded
            at all, by topic.
    """

    undecodable: dict[str, str]

    def __init__(self, connections: Iterable[Connection]) -> None:
        self.undecodable = {}
        self._catalog = DefinitionCatalog()
        self._sample_types: dict[Connection, type[Sample]] = {}
        self._stamp_places: dict[Connection, _StampPlace | None] = {}
        for connection in connections:
            try:
                self._catalog.store_for(connection)
            except DecodeError as error:
                self.undecodable[connection.topic] = error.what

    def sample_type(self, connection: Connection) -> type[Sample]:
        """Return the class that the messages of a topic decode to.

        A type that is named like a standard one but defined differently is an `OtherSample`.
        """
        if connection not in self._sample_types:
            self._sample_types[connection] = self._find_sample_type(connection)
        return self._sample_types[connection]

    def _find_sample_type(self, connection: Connection) -> type[Sample]:
        converter = CONVERTERS.get(connection.msgtype)
        store = self._store(connection)
        if converter is None or store is None:
            return OtherSample
        if converter.standard and not matches_standard(
            store, connection.msgtype, connection.encoding
        ):
            return OtherSample
        return converter.sample_type

    def _store(self, connection: Connection) -> Typestore | None:
        try:
            return self._catalog.store_for(connection)
        except DecodeError:
            return None

    def prepare(self, connection: Connection) -> None:
        """Build all that `decode` needs for a topic, so that several threads may then decode."""
        with contextlib.suppress(DecodeError, *_UNFIT):
            self.sample_type(connection)
            self._catalog.store_for(connection).get_msgdef(connection.msgtype)

    def decode(self, raw: RawMessage, notes: Counter[str] | None = None) -> list[Sample]:
        """Return the samples of one message: one, or one for each transform of a tf message.

        Args:
            raw: The message.
            notes: Counts what had to be left out of a sample, by reason, such as per-point
                times that make no sense.

        Raises:
            DecodeError: If the payload does not fit its definition or says what cannot be.
        """
        connection = raw.connection
        message = self._deserialize(raw)
        head = head_of(message, connection.topic, raw.log_time_ns)
        if self.sample_type(connection) is OtherSample:
            return [OtherSample(**head.fields(), msgtype=connection.msgtype, message=message)]
        notes = Counter() if notes is None else notes
        try:
            return CONVERTERS[connection.msgtype].convert(message, head, notes)
        except GeometryError as error:
            raise DecodeError(error.what, where=head.topic) from error

    def _deserialize(self, raw: RawMessage) -> RosMessage:
        connection = raw.connection
        store = self._catalog.store_for(connection)
        try:
            if connection.encoding == "ros1":
                return store.deserialize_ros1(raw.data, connection.msgtype)
            return store.deserialize_cdr(raw.data, connection.msgtype)
        except _UNFIT as error:
            raise DecodeError(
                f"{len(raw.data)} bytes are no '{connection.msgtype}' ({error})",
                where=connection.topic,
            ) from error

    def header_stamp_ns(self, raw: RawMessage) -> int | None:
        """Return the header stamp from the first bytes, without decoding the message.

        None for a type that does not start with a header and for a message that is too short.
        A tf message has the stamp of its first transform.
        """
        connection = raw.connection
        if connection not in self._stamp_places:
            self._stamp_places[connection] = self._find_stamp(connection)
        place = self._stamp_places[connection]
        if place is None or len(raw.data) < place.offset + 8:
            return None
        if place.is_first_of_sequence and not any(raw.data[place.start : place.start + 4]):
            return None
        little_endian = connection.encoding == "ros1" or raw.data[1] & 1
        layout = "II" if connection.encoding == "ros1" else "iI"
        seconds, nanoseconds = struct.unpack_from(
            ("<" if little_endian else ">") + layout, raw.data, place.offset
        )
        return int(seconds) * NS_PER_S + int(nanoseconds)

    def _find_stamp(self, connection: Connection) -> _StampPlace | None:
        store = self._store(connection)
        if store is None:
            return None
        start = 0 if connection.encoding == "ros1" else _CDR_ENCAPSULATION_BYTES
        if connection.msgtype in _TF_TYPES:
            header_at = start + 4
        elif _first_field(store, connection.msgtype) == (Nodetype.NAME, _HEADER):
            header_at = start
        else:
            return None
        has_sequence_number = _first_field(store, _HEADER) == (Nodetype.BASE, ("uint32", 0))
        offset = header_at + 4 * has_sequence_number
        return _StampPlace(start, offset, is_first_of_sequence=header_at != start)


class _StampPlace(NamedTuple):
    start: int
    offset: int
    is_first_of_sequence: bool


def _first_field(store: Typestore, msgtype: str) -> FieldDesc | None:
    fields = store.fielddefs[msgtype][1]
    return fields[0][1] if fields else None
