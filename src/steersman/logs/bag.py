"""Any ROS 2 recording through ``rosbags``: an MCAP file, a bag folder, an SQLite file.

A damaged file is an error of one line, whatever the libraries beneath make of it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from steersman.errors import DataError, SteersmanError, one_line, suggestion
from steersman.files import reading
from steersman.logs import schemas

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Reader

T = TypeVar("T")

_SUFFIXES = (".mcap", ".db3")
_CURE = "expected an .mcap or .db3 file, or the folder of a ROS 2 bag with its metadata.yaml"
_STANDARD = ("nav_msgs/", "geometry_msgs/")
# How recordings of ROS 1 begin: a bag; an MCAP file, whose header names its profile.
_ROS_1 = re.compile(rb"#ROSBAG V|\x89MCAP0\r\n\x01.{12}ros1", re.DOTALL)
_LONGEST_TEXT = 120
_MOST_TOPICS = 12


class Message(NamedTuple):
    """A decoded message and when it was logged."""

    logged: int
    """[ns]"""
    content: Any


class Recording:
    """An open recording."""

    def __init__(self, file: FilePath, reader: Reader) -> None:
        """Use :func:`opened`."""
        self.file = file
        self._reader = reader
        self.topics: dict[str, str] = {c.topic: c.msgtype for c in reader.connections}
        """Type of each topic."""

    def find(
        self, types: Iterable[str], topic: str | None = None, *, optional: bool = False
    ) -> str | None:
        """The topic of one of these types: ``topic``, our own, or the only one there is.

        Raises:
            DataError: there is no such topic, it holds something else, or there are several.
        """
        wanted = tuple(types)
        if topic is not None:
            if topic not in self.topics:
                raise self._no_topic(topic)
            if self.topics[topic] not in wanted:
                raise DataError(
                    f"{self.file}: topic {topic} holds {self.topics[topic]}, expected "
                    f"{' or '.join(wanted)}"
                )
            return topic
        found = sorted(name for name, kind in self.topics.items() if kind in wanted)
        own = [name for name in found if name in schemas.TYPES]
        if own or len(found) == 1:
            return (own or found)[0]
        if found:
            raise DataError(
                f"{self.file}: several topics hold {' or '.join(wanted)}: {', '.join(found)}; "
                "name one"
            )
        if optional:
            return None
        raise DataError(
            f"{self.file}: holds no {' or '.join(wanted)}; its topics: {self._listed()}"
        )

    def _no_topic(self, topic: str) -> DataError:
        near = suggestion(topic, self.topics)
        hint = near if "did you mean" in near else f"; its topics: {self._listed()}"
        return DataError(f"{self.file}: no topic {topic!r}{hint}")

    def _listed(self) -> str:
        names = [f"{name} ({kind})" for name, kind in sorted(self.topics.items())]
        rest = len(names) - _MOST_TOPICS
        more = [f"and {rest} more"] if rest > 0 else []
        return ", ".join(names[:_MOST_TOPICS] + more) or "none"

    def messages(self, topic: str, take: Callable[[Message], T]) -> list[T]:
        """What ``take`` makes of each message of a topic, as they were logged; [] without any.

        A message is not kept: those of an hour hold a gigabyte of covariances.
        """
        connections = [c for c in self._reader.connections if c.topic == topic]
        decode = _decoder(connections[0])
        return [
            take(Message(logged, decode(raw, connections[0].msgtype)))
            for _, logged, raw in self._reader.messages(connections=connections)
        ]

    def some(self, topic: str, take: Callable[[Message], T]) -> list[T]:
        """The same of a topic that must not be empty.

        Raises:
            DataError: it holds no message.
        """
        found = self.messages(topic, take)
        if not found:
            raise DataError(f"{self.file}: topic {topic} holds no message")
        return found


def _decoder(connection: Connection) -> Any:
    """What decodes a connection's messages.

    Standard messages are read as ROS 2 defines them; the others as the recording does, since
    Autoware's and ours have changed and may change.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = schemas.typestore()
    own = connection.msgdef
    if own.format == MessageDefinitionFormat.MSG and not connection.msgtype.startswith(_STANDARD):
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(own.data, connection.msgtype))
    return store.deserialize_cdr


@contextmanager
def opened(file: FilePath) -> Iterator[Recording]:
    """A recording, open as long as the block lasts.

    Raises:
        DataError: it is missing, of another kind, or damaged (also found in mid-block).
    """
    from rosbags.rosbag2 import Reader

    place = _existing(file)
    try:
        with Reader(place) as reader:
            yield Recording(file, reader)
    except SteersmanError:
        raise
    except Exception as error:  # a damaged file makes its readers raise anything
        what = one_line(str(error))[:_LONGEST_TEXT] or type(error).__name__
        raise DataError(
            f"{file}: cannot be read as a ROS 2 recording, it may be damaged ({what})"
        ) from error


def _existing(file: FilePath) -> FilePath:
    place = FilePath(os.path.expanduser(file))
    if place.is_dir():
        if not (place / "metadata.yaml").is_file():
            raise DataError(f"{file}: is a folder without metadata.yaml; {_CURE}")
        return place
    with reading(file, _CURE) as stream:
        if _ROS_1.match(stream.read(64)):
            raise DataError(
                f"{file}: is a recording of ROS 1; 'rosbags-convert --src FILE.bag --dst FOLDER' "
                "makes one of ROS 2 of its bag"
            )
        if place.suffix not in _SUFFIXES:
            raise DataError(f"{file}: is no recording; {_CURE}")
    return place
