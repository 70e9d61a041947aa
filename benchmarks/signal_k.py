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
"""Deltas of `track_bridge` against the published schema of Signal K, by the npm packages.

A scene of 20 tracks on a side of 180 degrees of longitude and across it, and their ends, goes over
UDP on this machine through the input of Signal K's server (@signalk/streams) to its schema
(@signalk/signalk-schema): each delta, and the full model that they make, must be valid.

    python benchmarks/signal_k.py [--folder build/signal_k]

Needs node and npm, which installs the two packages into the folder.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import uuid
from pathlib import Path

import numpy as np

from tsepm_ros.tools.bridge import nmea
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays
from tsepm_ros.whole_files import write_whole_text

PACKAGES = ("@signalk/signalk-schema", "@signalk/streams")
LONGITUDES = (10.63, 179.99, -179.99)
STAMP, TRACKS = 1_700_000_000.25, 20
READER = """
const schema = require('@signalk/signalk-schema')
const Udp = require('@signalk/streams/udp').default
const FromJson = require('@signalk/streams/from_json').default
const { Writable } = require('stream')
const wanted = Number(process.argv[2])
const deltas = []
const app = { on() {}, setProviderError(_, message) { console.error(message) } }
const udp = new Udp({ port: Number(process.argv[3]), app, providerId: 'udp' })
const json = new FromJson()
udp.pipe(json)
json.pipe(new Writable({ objectMode: true, write(delta, _, done) {
  deltas.push(delta)
  if (deltas.length === wanted) report()
  done()
} }))
udp.socket.on('listening', () => console.log('listening'))
function report() {
  const invalid = deltas.map(one => schema.validateDelta(one)).filter(one => !one.valid)
  const held = deltas.filter(one => one.updates[0].values[0].value !== null)
  const ends = deltas.filter(one => one.updates[0].values[0].value === null)
  const full = new schema.FullSignalK()
  held.forEach(one => full.addDelta(one))
  const tree = full.retrieve()
  tree.self = Object.keys(tree.vessels)[0]
  tree.version = '1.8.2'
  const whole = schema.validateFull(tree)
  const places = Object.values(tree.vessels).map(one => [
    one.name, one.navigation.position.value.longitude, one.navigation.position.value.latitude,
    one.navigation.courseOverGroundTrue.value, one.navigation.speedOverGround.value])
  ends.forEach(one => full.addDelta(one))
  const left = Object.values(tree.vessels).filter(one => one.navigation.position.value !== null)
  console.log(JSON.stringify({
    deltas: deltas.length, invalid: invalid.map(one => one.errors), ends: ends.length,
    vessels: places.length, model_valid: whole.valid, places,
    with_a_position_after_the_ends: left.length }))
  process.exit(0)
}
"""


def scene(longitude: float) -> tuple[list[str], np.ndarray]:
    """Deltas of tracks and of their ends, and the true places, course and speed."""
    rng = np.random.default_rng(1)
    state = np.stack([*rng.uniform(-9000, 9000, (1, TRACKS)), *rng.normal(0, 4, (3, TRACKS))], 1)
    state[:, 2] = rng.uniform(-9000, 9000, TRACKS)
    held = [ConfirmedTrack(k, STAMP, state[k], np.eye(4), (), 0.0) for k in range(TRACKS)]
    tracks = TrackArrays.from_tracks(held)
    places = GeographicReference(59.65, longitude).geographic(state[:, 0::2])
    instance = uuid.uuid5(uuid.NAMESPACE_URL, str(longitude))
    told = nmea.NmeaReports()
    lines = told.texts(set(range(TRACKS)), STAMP, nmea.nmea_deltas(tracks, instance, places))
    lines += told.texts(set(), STAMP + 1.0, {})
    course = np.arctan2(state[:, 1], state[:, 3]) % (2 * np.pi)
    truth = np.column_stack([places[:, ::-1], course, np.hypot(state[:, 1], state[:, 3])])
    return lines, truth


def main() -> int:
    """Print what the packages say; 0 if all is valid and at its place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("build/signal_k"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    command = ["npm", "install", "--no-save", "--prefix", str(folder), *PACKAGES]
    subprocess.run(command, check=True, capture_output=True)
    for name in PACKAGES:
        package = json.loads((folder / "node_modules" / name / "package.json").read_text())
        print(name, package["version"])
    write_whole_text(folder / "reader.js", READER)
    scenes = [scene(longitude) for longitude in LONGITUDES]
    lines = [line for lines, _ in scenes for line in lines]
    truth = np.concatenate([truth for _, truth in scenes])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    reader = subprocess.Popen(
        ["node", "reader.js", str(len(lines)), str(port)],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert reader.stdout is not None
    assert reader.stdout.readline() == "listening\n"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for line in lines:
            sender.sendto(line.encode("ascii"), ("127.0.0.1", port))
    answer = json.loads(reader.communicate(timeout=60)[0])
    places = np.array([place[1:] for place in answer.pop("places")], float)
    errors = np.abs(places - truth).max(axis=0)
    print(json.dumps(answer))
    print(
        "largest errors: longitude {:.1e}, latitude {:.1e}, course {:.1e}, speed {:.1e}".format(
            *errors
        )
    )
    is_valid = answer["model_valid"] and not answer["invalid"] and (errors < 1e-3).all()
    return 0 if is_valid and not answer["with_a_position_after_the_ends"] else 1


if __name__ == "__main__":
    raise SystemExit(main())
