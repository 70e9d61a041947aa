"""Every supported type: from messages to confirmed tracks, written and read back, and spoilt."""

import dataclasses
import math
import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import String
from support import foreign_messages
from support.driver_messages import MAKERS, echoes_of

from msg_adapters import (
    MessageError,
    detections,
    make_header,
    message_class,
    read_detections,
    supported_types,
    write_detections,
)
from msg_adapters.ping import good_detections
from msg_adapters.point_cloud import NO_TIMES
from msg_adapters.stamps import time_to_ns
from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings

START = 1_700_000_000
PERIOD = 12
PINGS = 12

EVERY_TYPE = pytest.mark.parametrize("type_name", list(MAKERS))
SAID = {"PointCloud2": (NO_TIMES,), "LaserScan": (detections.NO_TIMES,)}
METHODS = pytest.mark.parametrize("method", ["tsepm", "score"])


@pytest.fixture
def _installed(monkeypatch):
    foreign_messages.install(monkeypatch)


def header_at(seconds: float, frame_id: str = "sonar") -> Any:
    return make_header(round(seconds * 1e9), frame_id)


def scan_of(range_: Any, azimuth: Any, **more: Any) -> Scan:
    return Scan(START, range_, azimuth, **more)


def test_every_supported_type_is_tested_here():
    assert set(MAKERS) == set(supported_types())


@METHODS
@EVERY_TYPE
def test_messages_give_the_tracks_of_the_core_on_the_same_numbers(type_name, method):
    # Both compute in float64 from the same numbers, float32 where the message has them: what
    # differs is the order of operations. 1e-9 of a state is micrometres.
    session = Session(Settings(SessionOptions(method=method)))
    core = make_initiator(method, sensor=SensorModel())
    confirmed = 0
    for index in range(PINGS):
        stamp = START + PERIOD * index
        message, numbers = MAKERS[type_name](header_at(stamp), echoes_of(index))
        detections = read_detections(message)
        said = SAID.get(type_name.rpartition("/")[2], ())
        assert (detections.dropped, detections.assumptions) == ({}, said)
        session.add_scan(detections.sensor_scan, 0.0)
        [result] = session.process()
        expected = core.process(Scan(stamp=stamp, **numbers))
        assert [track.hits for track in result.new] == [track.hits for track in expected]
        for one, other in zip(result.new, expected, strict=True):
            np.testing.assert_allclose(one.state, other.state, rtol=1e-9, atol=1e-9)
            scale = np.linalg.norm(other.covariance)
            np.testing.assert_allclose(one.covariance, other.covariance, rtol=0, atol=1e-9 * scale)
        confirmed += len(expected)
    assert confirmed >= 2, "the scene must confirm tracks, or nothing was compared"
    assert session.dropped == {}


@EVERY_TYPE
@pytest.mark.usefixtures("_installed")
def test_a_written_message_is_read_back(type_name):
    echoes = echoes_of(3, clutter=200)
    range_, azimuth = np.array([(echo.range, echo.azimuth) for echo in echoes]).T
    message = write_detections(
        type_name, header_at(START), scan_of(range_, azimuth), sound_speed=1480.0
    )
    assert type(message) is message_class(type_name)
    found = read_detections(message)
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id, found.dropped) == (
        START * 10**9,
        "sonar",
        {},
    )
    order, expected = np.argsort(found.scan.azimuth), np.argsort(azimuth)
    fineness = 2e-3 if type_name.endswith("LaserScan") else 1e-6  # rays are 0.01 degrees apart
    np.testing.assert_allclose(found.scan.azimuth[order], azimuth[expected], atol=fineness)
    np.testing.assert_allclose(np.sort(found.scan.range), np.sort(range_), rtol=1e-6)
    if found.scan.time_offset is not None:
        np.testing.assert_allclose(found.scan.time_offset, found.scan.range / 1480.0, rtol=1e-6)


@pytest.mark.usefixtures("_installed")
@EVERY_TYPE
def test_without_times_an_echo_is_of_range_over_sound_speed_where_that_is_given(type_name):
    message, numbers = MAKERS[type_name](header_at(START), echoes_of(0))
    unset, found = read_detections(message), read_detections(message, sound_speed=1450.0)
    np.testing.assert_array_equal(found.scan.range, unset.scan.range)
    given = "time_offset" in numbers
    height = 0.0 if found.sensor_scan.height is None else found.sensor_scan.height
    expected = numbers["time_offset"] if given else np.hypot(found.scan.range, height) / 1450.0
    np.testing.assert_allclose(found.scan.time_offset, expected, rtol=1e-6, atol=1e-9)
    assert (unset.scan.time_offset is None) == (not given)
    assert found.assumptions == ()


@pytest.mark.usefixtures("_installed")
@EVERY_TYPE
def test_features_are_written_where_the_type_has_a_place_for_them(type_name):
    features = {
        "intensity": np.array([7.0, 8.0]),
        "range_width": np.array([5.0, 6.0]),
        "azimuth_width": np.array([0.1, 0.2]),
        "range_rate": np.array([-2.5, 3.0]),
    }
    message = write_detections(
        type_name,
        header_at(START),
        scan_of(np.array([100.0, 200.0]), np.array([0.5, -0.5]), features=features),
        sound_speed=1500.0,
    )
    found = read_detections(message)
    assert len(found) == 2
    places = {"PointCloud2": set(features), "RadarScan": {"intensity", "range_rate"}}.get(
        type_name.rpartition("/")[2], set()
    )
    for name, values in features.items():
        if name in places:
            np.testing.assert_allclose(found.scan.features[name], values, rtol=1e-6)
        else:
            assert np.isnan(found.scan.features.get(name, np.nan)).all()


def written(name: str, range_: list[float], azimuth: list[float], sound_speed: float) -> Any:
    scan = scan_of(np.array(range_), np.array(azimuth))
    return write_detections(name, header_at(START), scan, sound_speed=sound_speed)


@pytest.mark.usefixtures("_installed")
@pytest.mark.parametrize("name", ["SonarDetections", "SonarRanges"])
def test_sonar_messages_cannot_be_written_without_a_sound_speed(name):
    with pytest.raises(ValueError, match="sound_speed"):
        written(f"marine_acoustic_msgs/msg/{name}", [1.0], [1.0], 0.0)


@pytest.mark.usefixtures("_installed")
def test_travel_times_are_written_for_what_is_ahead_only():
    azimuth = [0.5, 3.0, -0.5 + 2 * math.pi]
    name = "marine_acoustic_msgs/msg/SonarDetections"
    found = read_detections(written(name, [100.0, 200.0, 300.0], azimuth, 1500.0))
    np.testing.assert_allclose(found.scan.azimuth, [0.5, -0.5], atol=1e-6)


def test_detections_on_one_ray_are_written_beside_each_other():
    message = written("sensor_msgs/msg/LaserScan", [100.0, 200.0, 300.0], [0.5, 0.5, math.pi], 0.0)
    found = read_detections(message)
    np.testing.assert_array_equal(np.sort(found.scan.range), [100.0, 200.0, 300.0])


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


def test_a_type_that_has_changed_is_refused_by_the_name_of_its_field():
    radar = foreign_messages.RadarScan(header=header_at(START), returns=[Point()])
    with pytest.raises(MessageError, match=r"radar_msgs/msg/RadarScan .*at range;") as error:
        read_detections(radar)
    assert error.value.reason == "unknown_version"


def test_a_field_that_has_another_kind_of_value_is_of_another_version():
    radar = foreign_messages.RadarScan(header=header_at(START), returns=None)
    with pytest.raises(MessageError, match="another kind") as error:
        read_detections(radar)
    assert error.value.reason == "unknown_version"
    assert "object" not in str(error.value), "not the inside of the program"


NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-45, 3e38, -3e38, 1.6, 1e8)


def spoil(value: Any, rng: np.random.Generator, largest: float) -> Any:
    """A value of the same type with nasty numbers in it and of another length."""
    if isinstance(value, float):
        return rng.choice([*NASTY, largest]) if rng.random() < 0.2 else value
    if isinstance(value, int | str):
        return value
    if hasattr(value, "typecode") or isinstance(value, list):
        items = [spoil(item, rng, largest) for item in value]
        if rng.random() < 0.3:
            items = items[: rng.choice([0, 1, len(items) // 2])]
        return items
    return value


DOUBLES = (Point, Pose, Vector3)


def spoil_message(message: Any, rng: np.random.Generator) -> None:
    """Spoil every field of a message and of the messages in it, in place."""
    fields = getattr(message, "__slots__", ())
    largest = 1e308 if isinstance(message, DOUBLES) else 3e38
    for name in (field.lstrip("_") for field in fields if field != "_check_fields"):
        value = getattr(message, name)
        if hasattr(value, "__slots__") and not hasattr(value, "typecode"):
            spoil_message(value, rng)
        elif isinstance(value, list) and value and hasattr(value[0], "__slots__"):
            for item in value:
                spoil_message(item, rng)
            setattr(message, name, spoil(value, rng, largest))
        elif name not in ("covariance", "data", "fields"):
            setattr(message, name, spoil(value, rng, largest))


@EVERY_TYPE
@pytest.mark.filterwarnings("error")
def test_nothing_that_arrives_is_worse_than_refused(type_name):
    rng = np.random.default_rng(5)
    outcomes = set()
    for trial in range(80):
        message, _ = MAKERS[type_name](header_at(START), echoes_of(trial))
        if type_name.endswith("PointCloud2"):
            data = np.frombuffer(message.data, np.float32).copy()
            data[rng.random(len(data)) < 0.1] = rng.choice(NASTY)
            message.data = data.tobytes()[: rng.choice([len(data) * 4, len(data)])]
        else:
            spoil_message(message, rng)
        try:
            found = read_detections(message, sound_speed=1500.0 * (trial % 2))
        except MessageError as error:
            outcomes.add(error.reason)
            continue
        dataclasses.replace(found.scan)  # passes all the checks of the constructor
        outcomes |= found.dropped.keys()
        outcomes |= {"good"} if len(found) else set()
    assert len(outcomes) > 3, outcomes
    assert "good" in outcomes


def test_an_unknown_type_is_refused_with_the_known_ones_by_an_error_that_survives_pickling():
    with pytest.raises(MessageError) as error:
        read_detections(String())
    assert error.value.reason == "unknown_type"
    assert "'std_msgs/msg/String' is not supported" in str(error.value)
    assert "sensor_msgs/msg/PointCloud2" in str(error.value)
    error = pickle.loads(pickle.dumps(MessageError("short_data", "data is short")))
    assert (error.reason, str(error)) == ("short_data", "data is short")


def test_a_later_reader_needs_one_row_and_no_installed_package(monkeypatch):
    def read_ping(message, options):
        angle = np.array(message.bearings) * (-1.0 if options.bearing_reference == "bow" else 1.0)
        return good_detections(
            time_to_ns(message.header.stamp),
            message.header.frame_id,
            options,
            range=np.array(message.ranges),
            azimuth=angle,
        )

    class Ping(SimpleNamespace):
        __msgtype__ = "sonar_msgs/msg/Ping"

    monkeypatch.setitem(detections.READERS, "sonar_msgs/msg/Ping", read_ping)

    header = SimpleNamespace(stamp=SimpleNamespace(sec=3, nanosec=5), frame_id="sonar")
    message = Ping(header=header, ranges=[10.0, -1.0, 30.0], bearings=[1.0, 2.0, 3.0])
    assert "sonar_msgs/msg/Ping" in supported_types()
    found = read_detections(message)
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id) == (3_000_000_005, "sonar")
    np.testing.assert_array_equal(found.scan.azimuth, [-1.0, -3.0])
    np.testing.assert_array_equal(found.index, [0, 2])
    np.testing.assert_array_equal(
        read_detections(message, bearing_reference="north").scan.azimuth, [1, 3]
    )
