"""TODO: one sentence on what is shown of messages."""

from typing import Any

import numpy as np
import pytest
from support import foreign_messages
from support.driver_messages import MAKERS

from msg_adapters import (
    MessageError,
    make_header,
    message_class,
    write_detections,
)
from tsepm_ros import Scan

START = 1_700_000_000


def header_at(seconds: float, frame_id: str = "sonar") -> Any:
    return make_header(round(seconds * 1e9), frame_id)


def scan_of(range_: Any, azimuth: Any, **more: Any) -> Scan:
    return Scan(START, range_, azimuth, **more)


@pytest.mark.parametrize("type_name", [name for name in MAKERS if "sensor_msgs" not in name])
def test_a_package_that_is_not_installed_is_named(type_name, monkeypatch):
    foreign_messages.remove(monkeypatch)
    package = type_name.partition("/")[0]
    with pytest.raises(MessageError, match=f"needs the package '{package}'") as error:
        message_class(type_name)
    assert error.value.reason == "package_not_installed"
    nothing = np.zeros(0)
    with pytest.raises(MessageError, match=package):
        write_detections(type_name, header_at(START), scan_of(nothing, nothing), sound_speed=1500.0)
