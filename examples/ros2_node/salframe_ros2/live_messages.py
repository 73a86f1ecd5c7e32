"""The latest messages of running topics, read like those of a bag. Imports no ROS."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from salframe_import.bag import CAMERA_INFO, IMAGE, ODOMETRY, TF, MessageStore, StampedMessage

MAX_MESSAGES = {IMAGE: 30, CAMERA_INFO: 1, ODOMETRY: 1000, TF: 500}
"""Maximum number of stored messages of a topic, by message type. All static transforms are stored."""


class LiveMessages(MessageStore):
    """The latest messages of topics. Several threads may use it at the same time."""

    path = "the running topics"

    def __init__(self, types: Mapping[str, str]) -> None:
        """Create a store without messages.

        Args:
            types: Type of the messages of each topic, one of MAX_MESSAGES.
        """
        self._known_types = dict(types)
        self._lock = threading.Lock()
        self._messages = {
            topic: deque[StampedMessage](maxlen=None if topic.endswith("tf_static") else MAX_MESSAGES[kind])
            for topic, kind in types.items()
        }

    @property
    def types(self) -> dict[str, str]:  # type: ignore[override]
        """Type of the messages of each topic that has a message."""
        return {topic: kind for topic, kind in self._known_types.items() if self._messages[topic]}

    def add(self, topic: str, content: Any, received_ns: int) -> None:
        """Store a message of a topic. `received_ns` is the time at which it was received."""
        with self._lock:
            self._messages[topic].append(StampedMessage.of(content, received_ns))

    def messages(self, topics: Collection[str], at_log_ns: int | None = None) -> Iterator[tuple[str, StampedMessage]]:
        with self._lock:
            rows = [(topic, message) for topic in topics for message in self._messages.get(topic, ())]
        for topic, message in sorted(rows, key=lambda row: row[1].log_ns):
            if at_log_ns is None or message.log_ns == at_log_ns:
                yield topic, message
