# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""A stand-in of rosbag2_py, which is not on PyPI, with what its documentation promises.

The library rosbags reads the bags behind it. Times are those of rclpy.
"""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from rclpy.duration import Duration
from rclpy.time import Time
from rosbags.rosbag2 import Reader


class Info:
    """Reads what a bag has."""

    def read_metadata(self, uri: str, storage_id: str) -> Any:
        check(uri, storage_id)
        with Reader(uri) as reader:
            topics = [
                SimpleNamespace(
                    topic_metadata=SimpleNamespace(name=name, type=topic.msgtype),
                    message_count=topic.msgcount,
                )
                for name, topic in reader.topics.items()
            ]
            some = reader.message_count > 0
            return SimpleNamespace(
                topics_with_message_count=topics,
                message_count=reader.message_count,
                starting_time=Time(nanoseconds=reader.start_time if some else 0),
                duration=Duration(nanoseconds=reader.duration - 1 if some else 0),
                compression_mode=reader.compression_mode or "",
            )


class StorageOptions:
    """The bag, and the plugin of a file."""

    def __init__(self, uri: str, storage_id: str = "") -> None:
        self.uri, self.storage_id = uri, storage_id


class ConverterOptions:
    """No conversion."""

    def __init__(
        self, input_serialization_format: str = "", output_serialization_format: str = ""
    ) -> None:
        assert not input_serialization_format and not output_serialization_format


class StorageFilter:
    """Topics to read."""

    def __init__(self, topics: list[str]) -> None:
        self.topics = topics


class SequentialReader:
    """Reads messages one by one."""

    opened: list[str]

    def open(self, storage: StorageOptions, converter: ConverterOptions) -> None:
        check(storage.uri, storage.storage_id)
        self.opened.append(storage.uri)
        with Reader(storage.uri) as reader:
            self._left = [(c.topic, bytes(data), time) for c, time, data in reader.messages()]

    def set_filter(self, storage_filter: StorageFilter) -> None:
        self._left = [one for one in self._left if one[0] in storage_filter.topics]

    def seek(self, time: int) -> None:
        self._left = [one for one in self._left if one[2] >= time]

    def has_next(self) -> bool:
        return bool(self._left)

    def read_next(self) -> tuple[str, bytes, int]:
        return self._left.pop(0)


def check(uri: str, storage_id: str) -> None:
    """As ROS, which does not go by the suffix: a file needs its plugin, a folder has it written."""
    plugin = {".mcap": "mcap", ".db3": "sqlite3"}.get(Path(uri).suffix, "")
    if storage_id != plugin:
        raise RuntimeError(f"No plugin {storage_id!r} for {uri}")


def install(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Make it importable for a test; returns the bags that it opened so far."""
    opened: list[str] = []
    monkeypatch.setattr(SequentialReader, "opened", opened, raising=False)
    module = ModuleType("rosbag2_py")
    for one in (Info, StorageOptions, ConverterOptions, StorageFilter, SequentialReader):
        setattr(module, one.__name__, one)
    monkeypatch.setitem(sys.modules, "rosbag2_py", module)
    return opened
