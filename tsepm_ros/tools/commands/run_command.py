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
"""The commands `tsepm run` and `tsepm watch`: sources, tracks and what is written or shown of them.

A source is a recording, a bag or a simulated scenario, and for `tsepm watch` also live topics.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TextIO

from msg_adapters.image_messages import IMAGES
from msg_adapters.message_input import MessageInput
from msg_adapters.ping import ReadingOptions
from msg_adapters.sonar_images import ImageInput
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import Value, parameter_table
from tsepm_ros.session.consistency_checks import check_questions, explained_by_check
from tsepm_ros.session.drop_reasons import drop_reason_of
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.session.shared_picture import share_picture
from tsepm_ros.settings.node_options import InitiatorNodeOptions, ViewerNodeOptions, gate_lines
from tsepm_ros.settings.parameter_files import (
    parameter_file_section,
    parameter_file_text,
    unused_parameter_files,
)
from tsepm_ros.settings.settings import (
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    make_groups,
    options_by_sensor,
    settings_from,
    settings_sensors,
    settings_table,
)
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.bridge.nmea import nmea_report_writer
from tsepm_ros.tools.commands.arguments import (
    Arguments,
    CommandFailed,
    add_arguments,
    in_folder_argument,
    scenario_argument_names,
    seed,
)
from tsepm_ros.tools.commands.given_parameters import add_given_parameters, given_parameter_values
from tsepm_ros.tools.pictures.run_scene import RunScene, SceneScan
from tsepm_ros.tools.replay.bag import (
    DETECTIONS,
    LAND,
    OWN_SHIP,
    TRACKED,
    TRUTH,
    Bag,
    bag_moving_frames,
    find_bag_topics,
)
from tsepm_ros.tools.replay.image_folder import image_folder_detected
from tsepm_ros.tools.replay.offline import (
    BagInput,
    Stream,
    offline_bag_results,
    offline_bag_truth,
    offline_recording_results,
)
from tsepm_ros.tools.replay.recording import (
    DETECTIONS_FILE,
    GEOMETRY,
    METADATA,
    MOTION_FILES,
    TRUTH_FILE,
    Recording,
    read_recorded_own_ship,
    read_recording,
    recording_source_of,
    simulated_recording,
    write_simulated_recording,
)
from tsepm_ros.tools.replay.track_files import (
    TrackWriter,
    track_bag_file,
    track_lines_file,
    track_listing_file,
    track_table_file,
    write_truth_table,
)
from tsepm_ros.tools.simulation import Scenario, Simulator, load_scenario, shipped_scenarios
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tools.viewer.alarms import finite_tracks
from tsepm_ros.tools.viewer.gates import HEAD, GateCounter
from tsepm_ros.tools.viewer.page_content import (
    Notices,
    PageRecordedScene,
    page_image_frame,
)
from tsepm_ros.tools.viewer.page_files import write_page
from tsepm_ros.whole_files import (
    naming_file,
    opened_whole,
    refuse_overwriting_inputs,
    write_whole_text,
)

DRAWING = "tsepm_ros.tools.pictures.plan_position"

TOPIC_OPTIONS = {
    DETECTIONS: "detections",
    OWN_SHIP: "odometry",
    TRACKED: "tracked",
    TRUTH: "ground-truth",
    LAND: "land",
}
"""Names of the topic options of a bag, by role."""
OUTPUTS = (
    "tracks.csv",
    "current.csv",
    TRUTH_FILE,
    "crossings.csv",
    "tracks.mcap",
    "tracks.geojson",
    "tracks.nmea",
    "tracks.signalk",
    "picture.png",
)
"""Files that `tsepm run` writes in a folder."""
WRITTEN = (".csv", ".png", ".html", ".geojson", ".nmea")
"""Suffixes of outputs in the folder of a bag, which it does not read."""
RUN_ARGUMENTS: Arguments = {
    "--out": {
        "type": in_folder_argument,
        "help": "folder for tracks.csv, current.csv (confirmed tracks), tracks.mcap, picture.png, "
        "and truth.csv where the targets are known",
    },
    "--as": {
        "choices": ("geojson", "nmea", "signalk"),
        "dest": "form",
        "help": "confirmed tracks with latitude and longitude, in place of the table, or in the "
        "folder of --out as tracks.geojson, tracks.nmea (TLL) or tracks.signalk (deltas)",
    },
    "--origin": {
        "help": "of the tracks, for --as and --html: latitude,longitude in degrees, such as "
        "--origin=-33.9,151.2"
    },
    "--gate": {
        "action": "append",
        "default": [],
        "metavar": "X1,Y1,X2,Y2",
        "help": "count the tracks that cross this line of the fixed frame, m, by direction; may be "
        "repeated. With --out also crossings.csv",
    },
    "--picture": {"type": in_folder_argument, "help": "plan-position picture, such as run.png"},
    "--html": {
        "type": in_folder_argument,
        "help": "self-contained page with a time slider, such as run.html",
    },
}
SIMULATE_ARGUMENTS: Arguments = {
    "scenario": {"help": scenario_argument_names()},
    "out": {"type": in_folder_argument, "help": "folder of the recording, which must not exist"},
    "--seed": {"type": seed, "default": 1, "help": "default 1"},
}
OF_SENSOR = ("sensor.", "mounting.")
"""Groups of parameters of a sensor, of several in one picture."""
OPTIONS = ("host", "port", "token", "origin")
"""Options of the viewer that are arguments too."""


def add_run_source_arguments(parser: argparse.ArgumentParser, nargs: str | None = None) -> None:
    """Add the arguments that say what is processed, and with which parameters."""
    parser.add_argument(
        "recording",
        nargs=nargs,
        help="folder with detections.csv or images, or a .csv file; bag: folder with "
        "metadata.yaml, .mcap or .db3 file; "
        f"or scenario to simulate: {scenario_argument_names()}",
    )
    parser.add_argument(
        "more",
        nargs="*",
        metavar="recording",
        help="recordings of further sensors, for one picture; see --sensor",
    )
    parser.add_argument(
        "--sensor",
        action="append",
        default=[],
        metavar="NAME=FILE",
        help="name and parameter file of the sensor of each of several recordings, in their order",
    )
    parser.add_argument("--seed", type=seed, help="seed of a simulated scenario; default 1")
    for role, name in TOPIC_OPTIONS.items():
        parser.add_argument(
            f"--{name}",
            dest=f"topic_{role}",
            default="",
            metavar="TOPIC",
            help=f"topic of a bag to read as {role}"
            + ", of several sensors NAME=TOPIC,..." * (role == DETECTIONS),
        )
    add_given_parameters(parser)
    parser.set_defaults(out=None, picture=None, html=None, own_ship=[], of_sensor="")


@dataclass
class PreparedRun:
    """A prepared run.

    Attributes
    ----------
    title : str
    session : Session
    results : iterator of ScanResult
    truth : list of (m, 3) ndarray
        Time (s), x and y (m) of each target.
    judge : callable, optional
        Judges the starts of a scene, if the origin of the detections is known.
    notes : dict of str to str
        First message by reason.
    scans : int or None
        Number of scans of the recording, dropped ones included; None if it is not known.
    processed : int
        Number of scans that were processed so far.
    mounting_yaw : float or None
        As in `SceneScan.of`.
    images : ImageInput or None
        Makes the detections, where the messages are images.
    streams : list of Stream
        What is processed, unless it is a bag or simulated.
    parts : dict of str to PreparedRun
        Runs of several sensors that share the picture, by name.
    """

    title: str
    session: Session
    results: Iterator[ScanResult] = field(default_factory=lambda: iter(()))
    truth: list[FloatArray] = field(default_factory=list)
    judge: Callable[[RunScene], None] = lambda scene: None
    notes: dict[str, str] = field(default_factory=dict)
    scans: int | None = None
    processed: int = 0
    mounting_yaw: float | None = 0.0
    images: ImageInput | None = None
    streams: list[Stream] = field(default_factory=list)
    parts: dict[str, PreparedRun] = field(default_factory=dict)

    @property
    def north(self) -> bool:
        """Whether the axes of the tracks are known from north."""
        return self.session.own_ship.source != "none" or self.mounting_yaw is None

    def recorded_scene(self, origin: str = "") -> PageRecordedScene:
        """An empty scene for a page of this run; `origin` as for `PageRecordedScene`."""
        parts = {name: (part.session.settings, part) for name, part in self.parts.items()}
        return PageRecordedScene(
            *(self.title, self.north, self.truth, self.mounting_yaw),
            self.session.settings.sensor,
            origin,
            {name: (of.sensor, of.mounting, one.mounting_yaw) for name, (of, one) in parts.items()},
        )

    def page_of(self, recorded: PageRecordedScene) -> str:
        """The scene of the finished run, JSON."""
        plans = [
            page_image_frame(1e-9 * plan.stamp_ns, plan.cell, plan.levels.tobytes())
            for plan in (self.images and self.images.plans) or ()
        ]
        of_sensors = {name: part.notices for name, part in self.parts.items()}
        dropped, notes = ({}, []) if of_sensors else self.notices
        return recorded.document(dropped, notes, plans, of_sensors)

    @property
    def notices(self) -> Notices:
        """What was dropped, by reason, and other notes."""
        dropped = self.session.dropped
        return dropped, [note for reason, note in self.notes.items() if reason not in dropped]


def open_run(options: argparse.Namespace, stack: ExitStack) -> PreparedRun:
    """Open what the arguments of `add_run_source_arguments` name; `stack` closes it.

    Raises
    ------
    ValueError
        If an argument is not allowed, or a recording cannot be read.
    """
    if options.more or options.sensor:
        return _run_of_picture(options, stack)
    name, scenarios = options.recording, shipped_scenarios()
    path = Path(name)
    is_images = (path / GEOMETRY).exists() and not (path / DETECTIONS_FILE).exists()
    outputs = [
        *(output for output in (options.picture, options.html) if isinstance(output, Path)),
        *(options.out / output for output in OUTPUTS if options.out),
    ]
    given = [path, *(output for output in options.parameter if isinstance(output, Path))]
    if (path.suffix.lower() in (".yaml", ".yml") and path.name != METADATA) or (
        name in scenarios and not path.exists()
    ):
        refuse_overwriting_inputs(given, outputs)
        _refuse_unused(options, "a scenario")
        return _run_of_simulation(load_scenario(name), options)
    if not path.exists():
        raise ValueError(
            f"{name} is neither an existing path nor a shipped scenario: {', '.join(scenarios)}"
        )
    source, is_bag = (path, False) if is_images else recording_source_of(path)
    beside = source.iterdir() if is_bag and source.is_dir() else map(source.with_name, MOTION_FILES)
    refuse_overwriting_inputs(
        [
            *given,
            source,
            *(output for output in beside if output.suffix not in WRITTEN or not is_bag),
        ],
        outputs,
    )
    _refuse_unused(options, "a bag" if is_bag else "a recording")
    if is_bag:
        return _run_of_bag(stack.enter_context(Bag(source)), options)
    values = given_parameter_values(options.parameter)
    if is_images:
        into = Path(stack.enter_context(TemporaryDirectory()))
        of_poses = {
            key: value
            for key, value in values.items()
            if key.startswith("mounting.") or key == "own_ship_delay"
        }
        of_detector = of_poses | _values_of_detector(options, options.of_sensor)
        recording, coverage = image_folder_detected(path, into, outputs, of_detector)
        values = coverage | _shared_out_values(values)[1]
    else:
        recording = read_recording(source)
        if source.with_name(GEOMETRY).exists():
            recording.notes.append(
                f"{source.name} is read in place of the images beside it, without the coverage and "
                f"the mounting of {GEOMETRY}, and without images that have no detection"
            )
    if not recording.own_ship:  # of several recordings the first that has it gives it
        recording = replace(recording, own_ship=options.own_ship)
    return _run_of_recording(
        recording, options, "odometry" if recording.own_ship else "none", values
    )


def _run_of_picture(options: argparse.Namespace, stack: ExitStack) -> PreparedRun:
    """One picture of several recordings, each of a sensor with parameters of its own."""
    names = [options.recording, *options.more]
    given = given_parameter_values(options.parameter)
    files = dict(pair.partition("=")[::2] for pair in options.sensor)
    of_one = settings_sensors(TRACK_INITIATOR, given) if not files else ()
    if len(files or of_one) != len(names) or not all(files) or not all(files.values()):
        raise ValueError(
            f"{len(names)} recordings need as many --sensor NAME=FILE, in their order, each with "
            "another name and a parameter file, or a file with as many names in sensors"
        )
    if files and (own := [name for name in given if name.startswith(OF_SENSOR)]):
        raise ValueError(f"{own[0]} is of one sensor: give it in its file of --sensor")
    folders = [path if path.is_dir() else path.parent for path in map(Path, names)]
    own_ship = next(filter(None, (read_recorded_own_ship(folder, []) for folder in folders)), [])
    parts = dict[str, PreparedRun]()
    for name, recording in zip(files or of_one, names, strict=True):
        of_part = {
            "recording": recording,
            "more": [],
            "sensor": [],
            "parameter": [*([Path(files[name])] if files else []), *options.parameter],
            "of_sensor": "" if files else name,
            "own_ship": own_ship,
        }
        part = open_run(argparse.Namespace(**vars(options) | of_part), stack)
        if not part.streams:
            raise ValueError(f"{recording} is no recording, which several sensors need")
        parts[name] = part
    return _shared_run(parts)


def _shared_run(parts: dict[str, PreparedRun]) -> PreparedRun:
    """The run of a picture, of the runs on recordings of its sensors by name."""
    share_picture({name: part.session for name, part in parts.items()})
    first, streams = next(iter(parts.values())), [part.streams[0] for part in parts.values()]
    return PreparedRun(
        f"{', '.join(parts)}, method {first.session.settings.session.method}",
        first.session,
        offline_recording_results(streams),
        truth=next((part.truth for part in parts.values() if part.truth), []),
        scans=sum(len(recording.scans) for recording, _, _ in streams),
        mounting_yaw=first.mounting_yaw,
        parts=parts,
    )


def _refuse_unused(options: argparse.Namespace, source: str) -> None:
    """Refuse options that have no meaning for a source."""
    given = {name: getattr(options, f"topic_{role}") for role, name in TOPIC_OPTIONS.items()}
    unused = [f"--{name}" for name in given if given[name] and source != "a bag"]
    unused += ["--seed"] * (options.seed is not None and source != "a scenario")
    if unused:
        raise ValueError(
            f"{', '.join(unused)} has no meaning for {source}: topics are named of a bag, and the "
            "seed is that of a simulated scenario"
        )


def _shared_out_values(
    values: Mapping[str, Value],
) -> tuple[dict[str, Value], dict[str, Value]]:
    """Values of a run on images: the detector's, and all but those that are its alone."""
    detector, tracker = (
        {row.name for row in settings_table(groups)} for groups in (SONAR_DETECTOR, TRACK_INITIATOR)
    )
    return (
        {name: value for name, value in values.items() if name in detector},
        {name: value for name, value in values.items() if name not in detector - tracker},
    )


def _values_of_detector(options: argparse.Namespace, sensor: str) -> dict[str, Value]:
    """Values that files and assignments have for the `sonar_detector` of a sensor."""
    node = f"/{sensor}/sonar_detector".replace("//", "/")
    # A file may be the tracker's alone.
    fitting = [
        assignment
        for assignment in options.parameter
        if isinstance(assignment, str)
        or not unused_parameter_files(["--params-file", str(assignment)], node)
    ]
    return _shared_out_values(given_parameter_values(fitting, node))[0]


def _prepared(
    options: argparse.Namespace,
    source: str,
    known: Sequence[str],
    values: Mapping[str, Value],
    sensor: str = "",
) -> tuple[PreparedRun, InitiatorNodeOptions]:
    """A run without results, its session made from values of parameters, with its node options.

    `source` is the default of `own_ship_source`. The notes begin with those that are `known` of the
    recording. Of several sensors it is the run of one.
    """
    made = options_by_sensor(make_groups(TRACK_INITIATOR, {"own_ship_source": source, **values}))
    sensor = next(iter(made)) if len(made) == 1 else sensor
    if sensor not in made:
        raise ValueError(f"sensors names {', '.join(made)}, and this is one recording")
    groups = made[sensor]
    notes = dict(zip(known, known, strict=True))

    def note(reason: str, sentence: str) -> None:
        notes.setdefault(reason, sentence)

    settings = settings_from(groups)
    for question in check_questions(settings.sensor, settings.mounting):
        note(question, question)
    if source == "odometry" and settings.session.own_ship_source == "none":
        note("own_ship_source", "own_ship_source is none: the own ship of the source is not used")
    session, node = Session(settings, note), groups[InitiatorNodeOptions]
    if session.settings.session.own_ship_source == "tf":
        raise ValueError("own_ship_source tf is for the node only; offline use odometry or none")
    yaw = None if node.bearing_reference == "north" else settings.mounting.yaw
    return PreparedRun(_title(options, session), session, notes=notes, mounting_yaw=yaw), node


def _run_of_recording(
    recording: Recording, options: argparse.Namespace, source: str, values: Mapping[str, Value]
) -> PreparedRun:
    run, node = _prepared(options, source, recording.notes, values, options.of_sensor)
    stream = recording, run.session, ReadingOptions(node.bearing_reference, node.sound_speed)
    return replace(
        run,
        results=offline_recording_results([stream]),
        truth=recording.truth,
        scans=len(recording.scans),
        streams=[stream],
    )


def _run_of_bag(bag: Bag, options: argparse.Namespace) -> PreparedRun:
    names = settings_sensors(TRACK_INITIATOR, given_parameter_values(options.parameter))
    found = {name: _part_of_bag(bag, options, name) for name in names or ("",)}
    parts = {name: part for name, (part, _, _) in found.items()}
    if names:
        share_picture({name: part.session for name, part in parts.items()})
    inputs, (run, topics, _) = [one for _, _, one in found.values()], next(iter(found.values()))
    return replace(
        run,
        results=offline_bag_results(bag, topics, inputs),
        truth=offline_bag_truth(bag, topics, run.notes) if run_needs_scene(options) else [],
        scans=sum(bag.count(one.topic) for one in inputs),
        parts=parts if names else {},
    )


def _part_of_bag(
    bag: Bag, options: argparse.Namespace, sensor: str
) -> tuple[PreparedRun, dict[str, str], BagInput]:
    """The run of a sensor without results, the topics by role, and its input."""
    given = {role: getattr(options, f"topic_{role}") for role in TOPIC_OPTIONS}
    if sensor and given[DETECTIONS]:
        of_sensors = dict(pair.partition("=")[::2] for pair in given[DETECTIONS].split(","))
        given[DETECTIONS] = of_sensors.get(sensor, "")
    try:
        topics = find_bag_topics(bag.topics, given, sensor)
    except ValueError as error:
        names = ", ".join(f"--{name}" for name in TOPIC_OPTIONS.values())
        raise ValueError(f"{error} (topics are named by {names})") from None
    moving = bag_moving_frames(bag.topics)
    values = given_parameter_values(options.parameter)
    if moving and OWN_SHIP not in topics and "own_ship_source" not in values:
        raise ValueError(
            f"the bag has no odometry, but transforms on {moving}, which offline runs do not read: "
            "play the bag with scan_player to a node with own_ship_source:=tf, record odometry, or "
            "give -p own_ship_source:=none if the sensor does not move"
        )
    source = "odometry" if OWN_SHIP in topics else "none"
    shown = bag.topics[topics[DETECTIONS]] in IMAGES
    values = _shared_out_values(values)[1] if shown else values
    run, node = _prepared(options, source, bag.notes, values, sensor)
    if run.session.settings.session.own_ship_source == "none":
        topics.pop(OWN_SHIP, None)  # as in the node
    message_input = MessageInput(
        run.session, node, lambda sentence: run.notes.update({sentence: sentence})
    )
    if shown:
        own_ship = {"own_ship_source": run.session.settings.session.own_ship_source}
        groups = make_groups(SONAR_DETECTOR, own_ship | _values_of_detector(options, sensor))
        images = ImageInput(groups, run.session.drop, lambda note: run.notes.update({note: note}))
        images.plans = [] if options.html and not sensor else None  # a page shows one's
        run.images = images
    return run, topics, BagInput(topics[DETECTIONS], run.session, message_input, run.images)


def _run_of_simulation(scenario: Scenario, options: argparse.Namespace) -> PreparedRun:
    seed = 1 if options.seed is None else options.seed
    simulator = Simulator(scenario, seed)
    recording, origins = simulated_recording(simulator)
    values = scenario_parameters(scenario) | given_parameter_values(options.parameter)
    parts = dict[str, PreparedRun]()
    for name in scenario.of_each:
        own = [scan for scan in recording.scans if scan.sensor == name]
        of_part = argparse.Namespace(**vars(options) | {"of_sensor": name})
        parts[name] = _run_of_recording(replace(recording, scans=own), of_part, "odometry", values)
    run = _shared_run(parts) if scenario.sensors else parts[""]
    method = run.session.settings.session.method
    return replace(
        run,
        title=f"{scenario.name}, seed {seed}, method {method}",
        judge=lambda scene: scene.judge(simulator, recording, origins),
        streams=[],
    )


def scenario_parameters(scenario: Scenario) -> dict[str, Value]:
    """The parameters of a scenario's sensor, or sensors, by their names."""
    values: dict[str, Value] = {"sensors": tuple(scenario.sensors)} if scenario.sensors else {}
    for name, scene in scenario.of_each.items():
        for group in ("sensor", "mounting"):
            for key, value in asdict(getattr(scene, group)).items():
                values[f"{name}.{group}.{key}".lstrip(".")] = value
    return values


def run_simulate(options: argparse.Namespace) -> None:
    """Write a recording of a scenario, of several sensors one of each, and their parameters.

    Raises
    ------
    ValueError
        If the scenario is not allowed.
    """
    scenario, out = load_scenario(options.scenario), options.out
    simulator = Simulator(scenario, options.seed)
    out.mkdir()
    for name, part in (simulator.sensors or {"": simulator}).items():
        (out / name).mkdir(exist_ok=True)
        write_simulated_recording(part, out / name)
    lines, path = parameter_file_section(), out / "parameters.yaml"
    lines.extend(
        f"    {name}: {parameter_file_text(value)}"
        for name, value in scenario_parameters(scenario).items()
    )
    write_whole_text(path, "\n".join([*lines, ""]))
    folders = [str(out / name) for name in scenario.of_each]
    print(shlex.join(["tsepm", "run", *folders, "--params-file", str(path)]))


def _title(options: argparse.Namespace, session: Session) -> str:
    path = Path(options.recording)
    name = path.parent.name if path.name in (DETECTIONS_FILE, METADATA) else path.stem
    shown = (name or path.resolve().name).encode(errors="replace").decode()  # may be no UTF-8
    return f"{shown}, method {session.settings.session.method}"


def run_needs_scene(options: argparse.Namespace) -> bool:
    """Whether the output that is asked for draws the scene."""
    return bool(options.out or options.picture or options.html)


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tsepm run`."""
    add_run_source_arguments(parser)
    add_arguments(parser, RUN_ARGUMENTS)


def run_recording(options: argparse.Namespace) -> None:
    """Start tracks on a recording, a bag or a scenario, and write them.

    Raises
    ------
    ValueError
        If an argument is not allowed, or a recording cannot be read.
    """
    if options.origin and not (options.form or options.html):
        raise ValueError("--origin is for --as and --html, and neither is given")
    drawing = _drawing(options)
    with ExitStack() as stack:
        run = open_run(options, stack)
        if options.out:
            options.out.mkdir(exist_ok=True)
        recorded = run.recorded_scene(options.origin or "") if options.html else None
        begin = time.perf_counter()
        gates = GateCounter(gate_lines(";".join(options.gate)))
        scene = _process(run, options, recorded, gates)
        seconds = time.perf_counter() - begin
    for part in run.parts.values() or [run]:
        _report(part)
    for line, (left, right) in zip(options.gate, gates.counts, strict=True):
        print(f"gate {line}: {left} to the left, {right} to the right", file=sys.stderr)
    if options.out:
        duration = scene.scans[-1].stamp - scene.scans[0].stamp
        print(
            f"{len(scene.scans)} scans, {len(scene.starts)} confirmed tracks; {duration:.1f} s "
            f"in {seconds:.2f} s, {duration / seconds:.0f} times faster than real time"
        )
    if recorded is not None:
        write_page(options.html, recorded.title, run.page_of(recorded))
        print(f"page: {options.html}", file=sys.stderr)
    if drawing is not None:  # the last: its suffix may be that of no picture
        picture = options.picture or options.out / "picture.png"
        drawing.save(scene, picture)
        print(f"picture: {picture}", file=sys.stderr)


def _drawing(options: argparse.Namespace) -> ModuleType | None:
    """The module that draws the pictures that are asked for, if any."""
    try:
        return import_module(DRAWING) if options.picture or options.out else None
    except ImportError:
        if options.picture:
            raise ValueError("pictures need matplotlib, see the extra plot") from None
        print("no picture: it needs matplotlib, see the extra plot", file=sys.stderr)
        return None


def _process(
    run: PreparedRun,
    options: argparse.Namespace,
    recorded: PageRecordedScene | None,
    gates: GateCounter,
) -> RunScene:
    """Process the run, count at gates and write; the scene is empty if no output needs it."""
    scene = RunScene(run.title, truth=run.truth)
    with ExitStack() as stack:
        writers, crossings = _writers(options, run, stack), [HEAD]
        for result in terminal_progress(run.results, run.scans, "scans", "scan"):
            part = run.parts.get(result.scan.sensor, run)
            part.processed += 1
            for path, writer in writers.items():
                with naming_file(path):
                    writer(result)
            if recorded is not None:
                recorded.add(result, run.session.tracker)
            crossings += gates.observe(result.stamp, finite_tracks(result.current), result.frame_id)
            if run_needs_scene(options):
                scene.scans.append(
                    SceneScan.of(result, part.session.settings.sensor, part.mounting_yaw)
                )
        if options.out and run.truth and scene.scans:
            span = scene.scans[0].stamp, scene.scans[-1].stamp
            file = stack.enter_context(opened_whole(options.out / TRUTH_FILE))
            write_truth_table(file, run.truth, span, result.frame_id)
        if options.out and gates.lines:
            write_whole_text(options.out / "crossings.csv", "\n".join([*crossings, ""]))
    # Of an earlier run: what would be taken for the truth and the crossings of these tracks.
    for name, is_written in ((TRUTH_FILE, run.truth), ("crossings.csv", gates.lines)):
        if options.out and not is_written:
            (options.out / name).unlink(missing_ok=True)
    run.judge(scene)
    return scene


def _geographic_writer(
    options: argparse.Namespace, run: PreparedRun, file: TextIO, stack: ExitStack
) -> TrackWriter:
    """Writer of tracks with latitude and longitude.

    Raises
    ------
    ValueError
        If pyproj is not installed, or the origin is not allowed.
    """
    if not find_spec("pyproj"):  # of `GeographicReference`
        raise ValueError("--as needs pyproj: pip install pyproj, or apt install python3-pyproj")
    reference = GeographicReference.read(options.origin or "")
    if options.form != "geojson":
        return nmea_report_writer(file, reference, run.notes, options.form)
    return stack.enter_context(track_lines_file(file, reference))


def _writers(
    options: argparse.Namespace, run: PreparedRun, stack: ExitStack
) -> dict[Path, TrackWriter]:
    """Writers of the files in a folder, or else of the standard output, by path."""
    reason, folder = run.session.settings.make_tracker().reason, options.out
    if folder is None:
        if options.form:
            return {Path("standard output"): _geographic_writer(options, run, sys.stdout, stack)}
        table = sys.stdout.isatty() and track_listing_file(sys.stdout, reason, north=run.north)
        return {
            Path("standard output"): _in_frame(
                table or track_table_file(sys.stdout, reason, several_sensors=bool(run.parts))
            )
        }
    writers: dict[Path, TrackWriter] = {
        folder / name: _in_frame(
            track_table_file(
                stack.enter_context(opened_whole(folder / name)),
                reason_of_row,
                several_sensors=bool(run.parts),
            )
        )
        for name, reason_of_row in (("tracks.csv", reason), ("current.csv", None))
    }
    if options.form:
        path = folder / f"tracks.{options.form}"
        file = stack.enter_context(opened_whole(path))
        writers[path] = _geographic_writer(options, run, file, stack)
    try:
        path = folder / "tracks.mcap"
        writers[path] = _in_frame(stack.enter_context(track_bag_file(path)))
    except ImportError:
        print("no tracks.mcap: it needs rosbags, see the extra bags", file=sys.stderr)
    return writers


def _in_frame(writer: TrackWriter) -> TrackWriter:
    """A writer of tracks in the axes of the fixed frame, not in east and north."""
    return lambda result: writer(result.in_frame())


def _report(run: PreparedRun) -> None:
    """Print notes and drops.

    Raises
    ------
    CommandFailed
        If there is no scan; it says why.
    """
    dropped, sensor = run.session.dropped, run.session.sensor
    farthest, said = run.session.picture.misalignment
    if said and farthest == sensor:
        print(f"note: {said}", file=sys.stderr)
    of_sensor = f"{sensor}: " * bool(sensor)
    state = run.images.turns.state if run.images else ""
    run.notes |= {state: state} if state else {}
    for reason, sentence in run.notes.items():
        if reason not in dropped and (run.processed or not reason.startswith("lost ")):
            print(f"note: {of_sensor}{sentence}", file=sys.stderr)
    for reason, number in sorted(dropped.items()):
        sentence = run.notes.get(reason) or drop_reason_of(reason).meaning
        print(f"dropped: {of_sensor}{number} {reason}: {sentence}", file=sys.stderr)
    if not run.processed:
        scans = [reason for reason in dropped if drop_reason_of(reason).lost == "scan"]
        if state or not scans:
            raise CommandFailed(
                f"{of_sensor}no scan was made: {state or 'there are no detections'}"
            )
        main = max(scans, key=dropped.__getitem__)
        why = explained_by_check(main, dropped, run.notes)
        raise CommandFailed(f"{of_sensor}every scan was dropped, {dropped[main]} as {why}")


def add_watch_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tsepm watch`."""
    add_run_source_arguments(parser, nargs="?")
    for row in parameter_table(ViewerNodeOptions):
        if row.name in OPTIONS:
            parser.add_argument(
                f"--{row.name}", type=row.type, help=f"{row.description}; default {row.default!r}"
            )
    parser.add_argument(
        "--ros-args",
        nargs=argparse.REMAINDER,
        default=[],
        help="arguments of ROS for live topics, such as -r tracks/current:=/boat/tracks/current",
    )
    parser.set_defaults(html=True)


def run_watch(options: argparse.Namespace) -> None:
    """Serve a page of the live topics, or of a recording, until interrupted.

    Raises
    ------
    ValueError
        If an argument is not allowed, a recording cannot be read, or a library is missing.
    """
    given = {name: getattr(options, name) for name in OPTIONS if getattr(options, name) is not None}
    viewer = ViewerNodeOptions(**given)
    if options.recording is None:
        _refuse_unused(options, "live topics")
        _watch_live(options, given)
    else:
        _watch_recording(options, viewer)


def _watch_live(options: argparse.Namespace, given: dict[str, Value]) -> None:
    if options.parameter:
        raise ValueError(
            "-p sets parameters of the processing of a recording, and none is given; live topics "
            "are processed by the node track_initiator"
        )
    try:
        from tsepm_ros.tools.viewer.track_viewer import main
    except ImportError as error:
        raise ValueError(
            f"live topics need ROS 2 ({error}); tsepm watch RECORDING needs none"
        ) from None
    parameters = [
        part for name in given for part in ("-p", f"{name}:={parameter_file_text(given[name])}")
    ]
    if code := main(["--ros-args", *parameters, *options.ros_args]):
        raise SystemExit(code)


def _watch_recording(options: argparse.Namespace, viewer: ViewerNodeOptions) -> None:
    if options.ros_args:
        raise ValueError("--ros-args is for live topics, and a recording is given")
    from tsepm_ros.tools.viewer.page_server import PageServer

    with ExitStack() as stack:
        run = open_run(options, stack)
        recorded = run.recorded_scene(viewer.origin)
        server = PageServer(viewer, recorded.title)  # before the work: the port may be in use
        stack.callback(server.stop)
        for result in terminal_progress(run.results, run.scans, "scans", "scan"):
            run.parts.get(result.scan.sensor, run).processed += 1
            recorded.add(result, run.session.tracker)
        for part in run.parts.values() or [run]:
            _report(part)
        server.start(run.page_of(recorded))
        print(f"{len(recorded)} scans; open {server.url} (Ctrl-C ends)", flush=True)
        with suppress(KeyboardInterrupt):
            while not threading.Event().wait(1.0):  # another thread may have got the signal
                pass
