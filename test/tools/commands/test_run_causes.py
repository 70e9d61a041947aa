"""What `tsepm run` says where scans, detections or poses of a bag are lost: cause and remedy."""

import csv

import numpy as np
import pytest

pytest.importorskip("rosbags")

from support.bag_files import ODOMETRY, PARAMETERS, POINTS, Entry, cloud, odometry, write_bag

from tsepm_ros.tools.commands.cli import main

START, PERIOD, TARGET = 1000.0, 2.0, (900.0, -1.5, 300.0, 2.0)


def entries(stamps=None, frame="odom", covariance=None, until=45.0):
    """A target of 20 pings and clutter, beside odometry of a ship at rest."""
    rng = np.random.default_rng(1)
    for index in range(20):
        time = START + PERIOD * index
        x, vx, y, vy = TARGET
        x, y = x + vx * PERIOD * index, y + vy * PERIOD * index
        range_ = np.r_[np.hypot(x, y) + rng.normal(0, 5), rng.uniform(100, 2900, 3)]
        azimuth = np.r_[np.arctan2(y, x) + rng.normal(0, 0.005), rng.uniform(-3, 3, 3)]
        fields = {"range": range_, "azimuth": azimuth, "time_offset": range_ / 1500.0}
        message = cloud(time if stamps is None else stamps(time), "sonar", **fields)
        yield Entry(time + PERIOD, "/detections", POINTS, message)
    for second in np.arange(0.0, until, 0.5):
        message = odometry(START + second, 0.0, 0.0, 0.0)
        message.header.frame_id = frame
        if covariance is not None:
            message.pose.covariance = np.asarray(covariance, float)
        yield Entry(START + second + 0.01, "/own_ship/odometry", ODOMETRY, message)


def run(tmp_path, *more, **changes):
    """Code of a run of such a bag, and the number of its tracks."""
    ordered = sorted(entries(**changes), key=lambda entry: entry.time)
    bag = write_bag(tmp_path / "bag", ordered)
    values = [argument for value in (*PARAMETERS, *more) for argument in ("-p", value)]
    code = main(["run", str(bag), *values, "--out", str(tmp_path / "out")])
    with (tmp_path / "out" / "tracks.csv").open() as file:
        return code, list(csv.DictReader(file))


MINUS_ONE = np.array([-1.0, *np.zeros(35)])


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="usual"),
        pytest.param({"covariance": np.full(36, np.nan)}, id="covariance nan"),
        pytest.param({"covariance": np.full(36, np.inf)}, id="covariance inf"),
        pytest.param({"covariance": MINUS_ONE}, id="covariance -1"),
        pytest.param({"frame": "/odom"}, id="slash"),
    ],
)
def test_odometry_of_every_kind_of_driver_gives_the_track(capsys, tmp_path, changes):
    code, (row,) = run(tmp_path, "fixed_frame:=odom", **changes)
    assert code == 0
    assert float(row["state_x"]) == pytest.approx(900.0, abs=40.0)
    assert "dropped" not in capsys.readouterr().err


def test_the_first_cause_is_named_with_its_sentence_and_remedy(capsys, tmp_path):
    code, rows = run(tmp_path, "fixed_frame:=odom", frame="map")
    error = capsys.readouterr().err
    assert (code, rows) == (1, [])
    sentence = "own-ship data is in frame 'map', the fixed frame is 'odom'"
    assert f"dropped: 90 own_ship_frame: {sentence}" in error
    last = error.splitlines()[-1]
    assert last.startswith("failed: every scan was dropped, 20 as own_ship_missing after 90 ")
    assert f"{sentence}. Remedy: Set `fixed_frame`" in last
    assert error.count("Remedy") == 1


def test_the_remedy_comes_with_half_of_the_scans_lost(capsys, tmp_path):
    code, _ = run(tmp_path, until=16.0)
    error = capsys.readouterr().err
    assert code == 0
    assert (
        "of the last 14 scans were dropped, 7 as own_ship_stale" in error
        and "Compare the clocks" in error
    )


@pytest.mark.parametrize("stamp", [0.0, 1234.5])
def test_stamps_that_stand_still_are_said_with_the_remedy(capsys, tmp_path, stamp):
    code, _ = run(tmp_path, "own_ship_source:=none", stamps=lambda time: stamp)
    error = capsys.readouterr().err
    assert code == 0
    assert "scans were dropped" in error and "`header.stamp`" in error
