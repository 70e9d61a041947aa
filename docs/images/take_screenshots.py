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

    PYTHONPATH=test python docs/images/take_screenshots.py

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
from sensor_msgs.msg import Image
from support.browser import Browser, Tab

from msg_adapters import make_header

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
    with Browser() as opened:
        recorded(opened)
        live(opened)
        sonar(opened)
