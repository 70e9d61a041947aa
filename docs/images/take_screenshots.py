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
"""Take the screenshots of docs/watch_and_operate.md, in a headless Chromium.

    PYTHONPATH=test python docs/images/take_screenshots.py [recorded live sonar two_sonars]

The live pages are those of the nodes, as processes: simulator, track initiator and viewer, and the
sonar detector beside a driver of images, which is here.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
os.environ["ROS_HOME"] = tempfile.mkdtemp()  # no alarms of before

import numpy as np
import rclpy
from sensor_msgs.msg import Image, PointCloud2
from support.browser import Browser, Tab

from msg_adapters import detections_cloud, make_header

FOLDER = Path(__file__).parent
SCENARIO, SEED = "four_targets", 1
RATE_FACTOR = 20.0
PORT = 8471
SCANS, LAST_STAMP = 16, 180.0


def live_page(browser: Browser) -> Tab:
    """The viewer's page, once it answers."""
    while True:
        try:
            socket.create_connection(("127.0.0.1", PORT), 1.0).close()
            break
        except OSError:
            time.sleep(0.1)
    tab = browser.tab(theme="dark")
    tab.open(f"http://127.0.0.1:{PORT}/")
    return tab


def live(browser: Browser) -> None:
    """The page beside the running nodes, after the scenario's last ping."""
    nodes = {
        "track_viewer": [f"port:={PORT}"],
        "track_initiator": ["own_ship_source:=odometry", "publish_potential_tracks:=true"],
        "sonar_simulator": [
            f"scenario:={SCENARIO}",
            f"seed:={SEED}",
            f"rate_factor:={RATE_FACTOR}",
        ],
    }
    processes = []
    try:
        for name, parameters in nodes.items():
            given = [part for parameter in parameters for part in ("-p", parameter)]
            command = [str(Path(sys.executable).with_name(name)), "--ros-args", *given]
            processes.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        tab = live_page(browser)
        tab.until(f"scene.frames.some((frame) => frame.stamp >= {LAST_STAMP})")
        tab.value("select(3)")
        tab.picture(FOLDER / "watching_live.png")
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(20.0)


def images(number: int) -> Iterator[Image]:
    """Speckle of an imaging sonar, and two targets that move apart, 5 images a second."""
    rng, beams, cells = np.random.default_rng(2), 128, 300
    row, column = np.ogrid[:cells, :beams]
    for k in range(number):
        field = rng.rayleigh(16.0, (cells, beams))
        for begin, speed, at in ((110.0, 0.9, 45.0), (200.0, -0.7, 84.0)):
            away = ((row - begin - speed * k) / 3.0) ** 2 + ((column - at) / 1.3) ** 2
            field += 160.0 * np.exp(-0.5 * away)
        shown = np.minimum(field, 255.0).astype(np.uint8)[::-1]
        yield Image(
            header=make_header(time.time_ns(), "sonar"),
            height=cells,
            width=beams,
            step=beams,
            encoding="mono8",
            data=shown.tobytes(),
        )


YAWS = {"port": 0.7, "starboard": -0.7}
"""Directions of two sonars, rad from the bow to port."""


def echoes(rng: np.random.Generator, yaw: float, stamp: float) -> dict[str, np.ndarray]:
    """Detections of a sonar of 50 m and 120 degrees: targets that cross ahead, and false ones."""
    place = np.array([28 + 22j, 22 - 24j, 36 + 2j, 20 - 3j])
    place += (stamp - 24.0) * np.array([0.3 - 0.5j, -0.4 + 0.4j, -0.6 - 0.1j, 0.3 + 0.6j])
    seen = place * np.exp(-1j * yaw)
    seen = seen[(np.abs(np.angle(seen)) < 1.05) & (rng.random(len(seen)) < 0.9)]
    false = 50.0 * np.sqrt(rng.random(4)) * np.exp(1j * rng.uniform(-1.05, 1.05, 4))
    found = np.append(np.abs(seen), np.abs(false)), np.append(np.angle(seen), np.angle(false))
    errors = rng.normal(0.0, 1.0, (2, len(found[0])))
    return {"range": found[0] + 0.1 * errors[0], "azimuth": found[1] + 0.01 * errors[1]}


def two_sonars(browser: Browser) -> None:
    """The page beside a node of two sonars and their drivers."""
    sensor = {"max_range": 50.0, "azimuth_min": -1.05, "azimuth_max": 1.05, "range_std": 0.1}
    sensor |= {"azimuth_std": 0.01, "range_std_fraction": 0.0}
    initiator = ["sensors:=[port, starboard]", "max_speed:=2.0"]
    initiator += [f"sensor.{name}:={value}" for name, value in sensor.items()]
    initiator += [f"{name}.mounting.yaw:={yaw}" for name, yaw in YAWS.items()]
    processes, rng = [], np.random.default_rng(4)
    rclpy.init()
    driver = rclpy.create_node("driver")
    publishers = {
        name: driver.create_publisher(PointCloud2, f"{name}/detections", 10) for name in YAWS
    }
    try:
        for name, parameters in {
            "track_viewer": [f"port:={PORT}"],
            "track_initiator": initiator,
        }.items():
            given = [part for parameter in parameters for part in ("-p", parameter)]
            command = [str(Path(sys.executable).with_name(name)), "--ros-args", *given]
            processes.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        while not all(one.get_subscription_count() for one in publishers.values()):
            time.sleep(0.1)
        tab = live_page(browser)
        for ping in range(60):
            for name, publisher in publishers.items():
                cloud = detections_cloud(
                    make_header(time.time_ns(), "vessel"), **echoes(rng, YAWS[name], 0.4 * ping)
                )
                publisher.publish(cloud)
                time.sleep(0.2)
        tab.until("scene.sensors(scene.frames.at(-1)).every((one) => one.pose && one.sector)")
        tab.value(
            "plan.moved = true; plan.center = [20, 0]; plan.scale = 7;"
            "select(scene.frames.at(-1).tracks[0][0]); redraw()"
        )
        tab.picture(FOLDER / "two_sonars.png")
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(20.0)
        rclpy.shutdown()


def sonar(browser: Browser) -> None:
    """The page beside both nodes and a driver of images, with the image shown."""
    coverage = ["sensor.max_range:=60.0", "sensor.azimuth_min:=-1.0", "sensor.azimuth_max:=1.0"]
    nodes = {
        "track_viewer": [f"port:={PORT}"],
        "track_initiator": [*coverage, "max_speed:=3.0"],
        "sonar_detector": [*coverage, "false_detections_per_ping:=5.0"],
    }
    processes = []
    rclpy.init()
    driver = rclpy.create_node("driver")
    publisher = driver.create_publisher(Image, "image", 10)
    try:
        for name, parameters in nodes.items():
            given = [part for parameter in parameters for part in ("-p", parameter)]
            command = [str(Path(sys.executable).with_name(name)), "--ros-args", *given]
            processes.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        while not publisher.get_subscription_count():
            time.sleep(0.1)
        tab = live_page(browser)
        tab.press("#layer-image")
        for message in images(100):
            publisher.publish(message)
            time.sleep(0.2)
        tab.until(
            "scene.images.length && scene.images[0] && scene.frames.at(-1).tracks.length >= 2"
        )
        tab.value("plan.moved = true; plan.center = [30, 0]; plan.scale = 9; redraw()")
        tab.picture(FOLDER / "watching_sonar.png")
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            process.wait(20.0)
        rclpy.shutdown()


def shown_recording(tab: Tab, page: Path) -> None:
    """Open a page and wait until it shows its recording."""
    tab.open(page.as_uri())
    tab.until(f"scene.frames.length === {SCANS} && byId('clock').textContent !== ''")


def recorded(browser: Browser) -> None:
    """The self-contained file, on a desk and on a telephone."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "run.html"
        command = [sys.executable, "-m", "tsepm_ros.tools.commands.cli", "run", SCENARIO]
        command += ["--seed", str(SEED), "--html", str(page)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        desk = browser.tab(theme="light")
        shown_recording(desk, page)
        # Near the track, so that its hits and their order are seen.
        desk.value(
            "select(3); show(15); plan.moved = true;"
            "plan.center = [scene.frames[15].tracks.find((row) => row[0] === 3)[1],"
            " scene.frames[15].tracks.find((row) => row[0] === 3)[2]]; plan.scale = 0.28;"
            "document.querySelector('#selected details').open = true; redraw(); showPanels()"
        )
        desk.picture(FOLDER / "watching_recording.png")
        phone = browser.tab(theme="dark")
        phone.size(390, 844, phone=True)
        shown_recording(phone, page)
        phone.value("move(SCANS); select(1)".replace("SCANS", str(SCANS)))
        phone.picture(FOLDER / "watching_phone.png")


if __name__ == "__main__":
    shown = {"recorded": recorded, "live": live, "sonar": sonar, "two_sonars": two_sonars}
    with Browser() as opened:
        for name in sys.argv[1:] or shown:
            shown[name](opened)
