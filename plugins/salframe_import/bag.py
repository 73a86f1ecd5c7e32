"""Open a ROS 1 or ROS 2 bag with the library rosbags, without ROS, and choose its topics."""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.errors import DataError, describe_error

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, ODOMETRY, TF = "sensor_msgs/msg/CameraInfo", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
TF_TYPES = (TF, "tf/msg/tfMessage")
"""Types of the topics /tf and /tf_static. ROS 1 before Hydro used the second type."""
ROS1_SUFFIX = ".bag"
_DISTRIBUTIONS = {
    "foxy": "ROS2_FOXY",
    "galactic": "ROS2_GALACTIC",
    "humble": "ROS2_HUMBLE",
    "iron": "ROS2_IRON",
    "jazzy": "ROS2_JAZZY",
    "kilted": "ROS2_KILTED",
}
DISTRIBUTIONS = tuple(_DISTRIBUTIONS)
"""ROS 2 distributions whose message definitions can be used for bags without definitions. ROS 1 bags always have
definitions."""


@dataclass(frozen=True)
class StampedMessage:
    """A message of a bag.

    Attributes:
        stamp_ns: Header stamp in nanoseconds; the recording time if the type has no header.
        log_ns: Recording time in nanoseconds.
        content: The message, as rosbags reads it.
    """

    stamp_ns: int
    log_ns: int
    content: Any

    @classmethod
    def of(cls, content: Any, log_ns: int) -> StampedMessage:
        """Return a message whose content was recorded at `log_ns`."""
        stamp = getattr(getattr(content, "header", None), "stamp", None)
        return cls(log_ns if stamp is None else stamp.sec * 10**9 + stamp.nanosec, log_ns, content)


class MessageStore(ABC):
    """Base class of sources of ROS messages: a bag, or the latest messages of running topics.

    All methods raise DataError with a one-line message if messages cannot be read.

    Attributes:
        path: The file or folder; a name for error messages if there is none.
        types: Type of the messages of each topic.
    """

    path: Path | str
    types: dict[str, str]

    @abstractmethod
    def messages(self, topics: Collection[str], at_log_ns: int | None = None) -> Iterator[tuple[str, StampedMessage]]:
        """Yield (topic, message) in the order of their recording.

        Args:
            topics: Names of topics of the store.
            at_log_ns: Recording time of the messages to read; None: all messages.
        """

    def topics(self, types: Collection[str]) -> list[str]:
        """Return the names of the topics of these types, sorted."""
        return sorted(topic for topic, kind in self.types.items() if kind in types)

    def choose(
        self, option: str, name: str | None, types: Collection[str], candidates: Collection[str] | None = None
    ) -> str:
        """Return the topic that an option names, or the only candidate.

        Args:
            option: Name of the option, for error messages.
            name: Value of the option; None: the only candidate.
            types: Types that the topic may have.
            candidates: Topics to choose from; None: all topics of these types.

        Raises:
            DataError: The topic is missing or has another type, or `name` is None and there is not exactly one
                candidate.
        """
        candidates = self.topics(types) if candidates is None else candidates
        expected = " or ".join(types)
        if name is not None:
            if name not in self.types:
                raise DataError(
                    f"{self.path} has no topic {name}, expected a topic of the type {expected}: {_listed(candidates)}"
                )
            if self.types[name] not in types:
                raise DataError(f"the topic {name} has the type {self.types[name]}, expected {expected}")
            return name
        if len(candidates) != 1:
            count = "no topic" if not candidates else f"{len(candidates)} topics"
            listed = f"all topics: {self._all_topics()}" if not candidates else f"{_listed(candidates)}"
            fix = "expected one" if not candidates else f"expected one: select it with --set {option}=TOPIC"
            raise DataError(f"{self.path} has {count} of the type {expected} ({listed}), {fix}")
        return next(iter(candidates))

    def first(self, topic: str) -> StampedMessage:
        """Return the first message of a topic. Raises DataError if it has none."""
        for _, message in self.messages([topic]):
            return message
        raise DataError(f"the topic {topic} of {self.path} has no message, expected at least one")

    def stamps(self, topics: Collection[str]) -> dict[str, np.ndarray]:
        """Return for each topic the header stamps and recording times of its messages.

        An array is (N, 2) int64 in nanoseconds, with one row per message. Rows are sorted by header stamp.

        Raises:
            DataError: A topic has no message, or a stamp is 0.
        """
        rows: dict[str, list[tuple[int, int]]] = {topic: [] for topic in topics}
        for topic, message in self.messages(topics):
            rows[topic].append((message.stamp_ns, message.log_ns))
        for topic, times in rows.items():
            if not times:
                raise DataError(f"the topic {topic} of {self.path} has no message, expected at least one")
            if min(times)[0] <= 0:
                raise DataError(
                    f"the topic {topic} of {self.path} has a message whose header stamp is 0, expected the time of the "
                    "measurement"
                )
        return {topic: np.array(sorted(times), np.int64) for topic, times in rows.items()}

    def read(self, topic: str, stamp_ns: int, log_ns: int) -> Any:
        """Return the message of a topic with this header stamp and this recording time."""
        for _, message in self.messages([topic], log_ns):
            if message.stamp_ns == stamp_ns:
                return message.content
        raise DataError(
            f"{self.path} no longer contains the message of the topic {topic} at {stamp_ns / 1e9:.3f} s: import the "
            "bag "
            "again"
        )

    def _all_topics(self) -> str:
        return _listed([f"{topic} [{kind}]" for topic, kind in sorted(self.types.items())])


class Bag(MessageStore):
    """An open ROS bag: a file .bag, .mcap or .db3, a folder of .bag files, or the folder of a ROS 2 bag.

    The bag is closed when this object is deleted.

    Attributes:
        files: The files of the bag.
    """

    def __init__(self, path: Path, distribution: str) -> None:
        """Open the bag.

        Args:
            path: The file or folder.
            distribution: One of DISTRIBUTIONS. Its message definitions are used if the bag has none.
        """
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.files = _bag_files(path)
        try:
            paths = [path] if self.files[0].suffix != ROS1_SUFFIX else self.files
            store = get_typestore(Stores[_DISTRIBUTIONS[distribution]])
            self._reader = AnyReader(paths, default_typestore=store)
            self._reader.open()
            weakref.finalize(self, self._reader.close)
        except Exception as error:  # rosbags raises the errors of its parsers too
            raise DataError(f"{path} cannot be read as a ROS bag: {describe_error(error)}") from None
        self.types = {connection.topic: connection.msgtype for connection in self._reader.connections}

    def messages(self, topics: Collection[str], at_log_ns: int | None = None) -> Iterator[tuple[str, StampedMessage]]:
        connections = [connection for connection in self._reader.connections if connection.topic in topics]
        if not connections:
            return
        stop = None if at_log_ns is None else at_log_ns + 1
        try:
            for connection, log_ns, raw in self._reader.messages(connections, at_log_ns, stop):
                content = self._reader.deserialize(raw, connection.msgtype)
                yield connection.topic, StampedMessage.of(content, log_ns)
        except DataError:
            raise
        except Exception as error:  # rosbags raises the errors of its parsers too
            raise DataError(
                f"cannot read the topics {', '.join(topics)} of {self.path}: {describe_error(error)}"
            ) from None


def _bag_files(path: Path) -> list[Path]:
    """Return the files of a bag. Raises DataError if there is none."""
    expected = "expected a ROS bag: a .bag, .mcap or .db3 file, a folder of .bag files, or a folder with metadata.yaml"
    if not path.exists():
        raise DataError(f"{path} does not exist, {expected}")
    if not path.is_dir():
        return [path]
    if (path / "metadata.yaml").exists():
        return sorted(file for file in path.iterdir() if file.is_file())
    if not (files := sorted(path.glob(f"*{ROS1_SUFFIX}"))):
        raise DataError(f"{path} has no metadata.yaml and no {ROS1_SUFFIX} file, {expected}")
    return files


def _listed(names: Collection[str], max_names: int = 20) -> str:
    names = list(names)
    more = f", ... ({len(names)} in all)" if len(names) > max_names else ""
    return ", ".join(names[:max_names]) + more or "none"
