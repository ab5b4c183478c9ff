"""Message definitions: those in the log, else the standard ROS types."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)

from percept.core.errors import DecodeError
from percept.datasets.messages import Connection

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc, Typesdict
    from rosbags.typesys.store import Typestore

__all__ = ["DefinitionCatalog", "matches_standard", "standard_types"]

ENCODINGS = ("ros1", "cdr")

# rosbags unrolls fixed arrays of strings and structures into source code, so that a length out
# of a broken definition would fill the memory.
_LONGEST_FIXED_ARRAY = 4096
_LONGEST_REASON = 120
_IDL_SEPARATOR = "=" * 80 + "\n"


@cache
def standard_types(encoding: str) -> Typestore:
    """Return the types that need no definition in the log.

    Args:
        encoding: `ros1` (Noetic, and the tf messages) or `cdr` (Jazzy, and what only Humble has).
    """
    if encoding == "ros1":
        store = get_typestore(Stores.ROS1_NOETIC)
        for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
        return store
    store = get_typestore(Stores.ROS2_JAZZY)
    humble = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    store.register({name: humble[name] for name in humble.keys() - store.fielddefs.keys()})
    return store


class DefinitionCatalog:
    """The typestores of one log.

    Two topics of one log may define the same type differently (a log joined from several
    vehicles, a driver that was updated). Definitions that agree share a store, because the
    readers that rosbags generates are costly; one that disagrees gets another store.
    """

    def __init__(self) -> None:
        self._stores: dict[str, list[Typestore]] = {encoding: [] for encoding in ENCODINGS}
        self._known: dict[tuple[str, str, str, str], Typestore | DecodeError] = {}

    def store_for(self, connection: Connection) -> Typestore:
        """Return the store that decodes the messages of a connection.

        Raises:
            DecodeError: If the encoding is not supported, the definition cannot be used, or
                there is none and the type is not a standard one.
        """
        key = (
            connection.encoding,
            connection.msgtype,
            connection.definition,
            connection.definition_format,
        )
        if key not in self._known:
            try:
                self._known[key] = self._find(connection)
            except DecodeError as error:
                self._known[key] = error
        known = self._known[key]
        if isinstance(known, DecodeError):
            raise DecodeError(known.what, where=connection.topic)
        return known

    def _find(self, connection: Connection) -> Typestore:
        topic = connection.topic
        if connection.encoding not in ENCODINGS:
            raise DecodeError(
                f"messages in the encoding '{connection.encoding}' cannot be decoded", where=topic
            )
        if "/srv/" in connection.msgtype:
            raise DecodeError("service calls are not decoded", where=topic)
        standard = standard_types(connection.encoding)
        if not connection.definition.strip():
            if connection.msgtype in standard.fielddefs:
                return standard
            raise DecodeError(
                f"the log carries no definition of '{connection.msgtype}'", where=topic
            )
        try:
            types = _parse(connection)
            _complete(types, connection.msgtype, standard)
            return self._register(types, connection.encoding)
        except (TypesysError, ValueError, KeyError, RecursionError, SyntaxError) as error:
            reason = " ".join(str(error).split())[:_LONGEST_REASON]
            raise DecodeError(
                f"the log's definition of '{connection.msgtype}' cannot be used ({reason})",
                where=topic,
            ) from error

    def _register(self, types: Typesdict, encoding: str) -> Typestore:
        for store in self._stores[encoding]:
            try:
                store.register(types)
            except TypesysError:
                continue
            return store
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        self._stores[encoding].append(store)
        return store


def matches_standard(store: Typestore, msgtype: str, encoding: str) -> bool:
    """Tell whether a store defines a standard type, and all that it is made of, as ROS does.

    More fields than the standard ones are accepted; a missing or differently typed field is not.
    """
    standard = standard_types(encoding).fielddefs.get(msgtype)
    if standard is None or msgtype not in store.fielddefs:
        return False
    found = dict(store.fielddefs[msgtype][1])
    for name, desc in standard[1]:
        if found.get(name) != desc:
            return False
        nested = _nested_type(desc)
        if nested is not None and not matches_standard(store, nested, encoding):
            return False
    return True


def _parse(connection: Connection) -> Typesdict:
    if connection.definition_format != "idl":
        return get_types_from_msg(connection.definition, connection.msgtype)
    types: Typesdict = {}
    text = connection.definition
    if not text.startswith(_IDL_SEPARATOR):
        return get_types_from_idl(text)
    for part in text.split(_IDL_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.partition("\n")[2]))
    return types


def _complete(types: Typesdict, msgtype: str, standard: Typestore) -> None:
    """Add the standard types that a definition refers to without giving them, and check it all."""
    waiting, seen = [msgtype], set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if name not in types:
            if name not in standard.fielddefs:
                raise ValueError(f"it does not define '{name}'")
            types[name] = standard.fielddefs[name]
        waiting += _references(types, name)
    _refuse_cycles(types, msgtype, ())


def _references(types: Typesdict, name: str) -> Iterator[str]:
    for field, desc in types[name][1]:
        nested = _nested_type(desc)
        if desc[0] == Nodetype.ARRAY:
            (kind, content), length = _array_parts(desc)
            unrolled = kind == Nodetype.NAME or content[0] == "string"
            if unrolled and length > _LONGEST_FIXED_ARRAY:
                raise ValueError(f"'{field}' is an array of {length} elements")
        if desc[0] == Nodetype.SEQUENCE and nested is not None and _takes_no_bytes(types, nested):
            # Its declared length is bounded by nothing in the message.
            raise ValueError(f"'{field}' is a sequence of nothing")
        if nested is not None:
            yield nested


def _refuse_cycles(types: Typesdict, name: str, above: tuple[str, ...]) -> None:
    if name in above:
        raise ValueError(f"'{name}' contains itself")
    for nested in _references(types, name):
        _refuse_cycles(types, nested, (*above, name))


def _takes_no_bytes(types: Typesdict, name: str) -> bool:
    return name in types and not types[name][1]


def _array_parts(desc: FieldDesc) -> tuple[Any, int]:
    content: Any = desc[1]
    return content[0], int(content[1])


def _nested_type(desc: FieldDesc) -> str | None:
    content: Any = desc[1]
    if desc[0] == Nodetype.NAME:
        return str(content)
    if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) and content[0][0] == Nodetype.NAME:
        return str(content[0][1])
    return None
