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
"""The command `tsepm init`: asks what a sonar is, and writes its parameter file.

The questions have the wordings of data sheets. Answers are numbers by the names of `QUESTIONS`, in
the units that data sheets use: angles in degrees, shares in percent. The parameters that follow are
in SI units and radians.
"""

from __future__ import annotations

import argparse
import math
import re
import shlex
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from msg_adapters.image_messages import image_in_words, image_side_in_words, located_image
from tsepm_ros.detector.image import DetectorOptions
from tsepm_ros.methods.registry import METHODS, registered_method
from tsepm_ros.parameters import Parameter, Value
from tsepm_ros.settings.node_options import (
    OWN_SHIP_SOURCES,
    ImageLayout,
    InitiatorNodeOptions,
)
from tsepm_ros.settings.parameter_files import ANY_NODE, parameter_file_section, parameter_file_text
from tsepm_ros.settings.settings import (
    OF_SENSOR,
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    check_image_ranges,
    make_groups,
)
from tsepm_ros.tools.design.prediction import PredictionCase, first_prediction
from tsepm_ros.tools.terminal import terminal_table
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.sensor import Coverage, SensorModel
from tsepm_ros.whole_files import write_whole_picture, write_whole_text

Answers = Mapping[str, float]
Sections = dict[str, dict[str, Value]]
"""Values of parameters by the key of their section."""
LEARNED = """the node learns the clutter density by place, the detection probability, and whether
targets have several detections in a ping"""
OF_IMAGES = ("rows", "near_range", "far_range", "near_row", "first_column", "standing")
"""Questions that are asked where the driver publishes images."""
SHARED = (
    *("sensor.min_range", "sensor.azimuth_min", "sensor.azimuth_max", "sound_speed"),
    *("own_ship_source", "mounting."),
)
"""Beginnings of parameters that both nodes have. The farthest range of the detector is that of the
images, which grows with the driver's range setting."""
UNIT_NAMES = {"degrees": ("degree", "deg", "°"), "%": ("percent",)}
CELL_TO_STD = 1.0 / math.sqrt(12.0)
"""Standard deviation of a value anywhere in a cell, as a share of the cell's width."""
ALL_ROUND = 360.0
MOST = 1e8
"""Largest answer of a question that states none."""
FALSE_DETECTIONS = (10.0, 50.0, 250.0)
"""False detections per ping for which the performance is estimated: they are not known before."""
MIN_STALE, STALE_PINGS = 5.0, 5.0
"""Silence after which the sonar counts as silent: at least so many seconds, and so many pings."""
ESTIMATED_SCANS = 32
"""Scans within which a target should be found, in the estimate."""
MOUNTING = (
    ("x", "ahead of the vessel's reference point", "m", 1e4),
    ("y", "to port of the vessel's reference point", "m", 1e4),
    ("yaw", "turned from the bow to port", "degrees", 180.0),
    ("roll", "rolled about its axis ahead, 180 if it hangs upside down", "degrees", 180.0),
)
"""Name, wording, unit and bound of the parts of the mounting that are asked for."""
STALE, OF_PICTURE = "diagnostics.stale_time", "it is of the picture as a whole; give it alone"
NAMES_PROMPT = """Names, if several sonars or radars make one picture (names)
  Such as port starboard. The following questions come for each. Enter alone: there is one.
  [one]: """
ROWS = ("auto", "ranges", "beams", "fan")
AT_REST, ODOMETRY = map(OWN_SHIP_SOURCES.index, ("none", "odometry"))
SENSOR, COMMON = SensorModel(), CommonOptions()
"""The defaults of the node."""
NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@dataclass(frozen=True)
class InitQuestion:
    """A question about the sonar, its targets or the operator's wish.

    Attributes
    ----------
    name : str
        Name of the answer and, with hyphens, of the command's argument.
    text : str
        What is asked for, as a data sheet has it.
    unit : str
    explanation : str
        One sentence: what the answer is used for, or where it is found.
    default_answer : float or callable
        The answer that is taken if none is given, or its function of the answers so far.
    minimum, maximum : float
        Inclusive bounds.
    positive : bool
        The answer must be above 0.
    choices : tuple of str
        The words to choose from, if any; the answer is the place of one.
    of_picture : bool
        The answer is that of all of several sensors.
    """

    name: str
    text: str
    unit: str
    explanation: str
    default_answer: float | Callable[[Answers], float]
    minimum: float = 0.0
    maximum: float = MOST
    positive: bool = False
    choices: tuple[str, ...] = ()
    of_picture: bool = False

    @property
    def argument(self) -> str:
        """Argument of the command line."""
        return "--" + self.name.replace("_", "-")

    def default(self, answers: Answers) -> float:
        """The answer that is taken if none is given, from the answers so far."""
        given = self.default_answer
        return given(answers) if callable(given) else given

    def read(self, text: str) -> float:
        """An answer from its text, with or without the unit.

        Raises
        ------
        ValueError
            If it is no number in the unit, or out of bounds; the message names the argument.
        """
        if self.choices:
            if text.strip() in self.choices:
                return float(self.choices.index(text.strip()))
            raise ValueError(
                f"{self.argument} must be one of {', '.join(self.choices)}; got {text.strip()!r}"
            )
        match = NUMBER.fullmatch(text)
        if match is None or match[2] not in ("", self.unit, *UNIT_NAMES.get(self.unit, ())):
            unit = f" of {self.unit}" if self.unit else ""
            raise ValueError(f"{self.argument} must be a number{unit}; got {text.strip()!r}")
        return self.checked(float(match[1]))

    def shown(self, value: float) -> str:
        """An answer as `read` takes it."""
        return self.choices[int(value)] if self.choices else f"{value:.12g}"

    def checked(self, value: float) -> float:
        """The answer, if it is within the bounds; else ValueError."""
        bounds = self.minimum, self.maximum, self.positive
        return float(Parameter(self.argument, 0.0, self.text, self.unit, *bounds).check(value))


def _of_cell(name: str, unknown: float) -> Callable[[Answers], float]:
    return lambda answers: float(f"{answers[name] * CELL_TO_STD:.3g}") or unknown


def _ping_interval(answers: Answers) -> float:
    """Two-way travel time to the farthest range, rounded up to two digits."""
    if not answers["sound_speed"]:
        return PredictionCase(sensor=SensorModel()).interval
    travel = 2.0 * answers["max_range"] / answers["sound_speed"]
    step = 10.0 ** (math.floor(math.log10(travel)) - 1)
    return float(f"{math.ceil(travel / step - 1e-9) * step:.2g}")


QUESTIONS = (
    InitQuestion(
        "max_range",
        "Range setting, the farthest range",
        "m",
        "Detections far beyond it are not used.",
        SENSOR.max_range,
        positive=True,
    ),
    InitQuestion(
        "min_range",
        "Blanking distance, the nearest range",
        "m",
        "Nearer targets cannot be detected; an image may begin at another range.",
        SENSOR.min_range,
    ),
    InitQuestion(
        "sector",
        "Swath or sector, the full angle covered",
        "degrees",
        f"{ALL_ROUND:g}: all round.",
        ALL_ROUND,
        maximum=ALL_ROUND,
        positive=True,
    ),
    InitQuestion(
        "sector_centre",
        "Middle of the sector",
        "degrees",
        "From the sensor's x axis, mostly ahead; left is positive.",
        0.0,
        minimum=-180.0,
        maximum=180.0,
    ),
    InitQuestion(
        "beam_width",
        "Beam width",
        "degrees",
        "Horizontal, at -3 dB; echoes nearer in bearing may be one target's. 0: not known.",
        0.0,
        maximum=math.degrees(1.0),
    ),
    InitQuestion(
        "bearing_accuracy",
        "Bearing accuracy, one standard deviation",
        "degrees",
        "An echo anywhere in a beam has the beam width / 3.5.",
        _of_cell("beam_width", 1.0),
        maximum=math.degrees(1.0),
        positive=True,
    ),
    InitQuestion(
        "range_cell",
        "Range resolution, the length of a resolution cell",
        "m",
        "Sound speed times pulse length / 2 if it is not stated. 0: not known.",
        0.0,
        maximum=1e4,
    ),
    InitQuestion(
        "range_accuracy",
        "Range accuracy, one standard deviation",
        "m",
        "An echo anywhere in a cell has the cell / 3.5.",
        _of_cell("range_cell", 0.0),
        maximum=1e5,
    ),
    InitQuestion(
        "range_error",
        "Range error that grows with range, one standard deviation",
        "%",
        "Mostly of the sound speed: 1.5 where it is assumed, 0.5 where it is measured.",
        100.0 * SENSOR.range_std_fraction,
        maximum=100.0,
    ),
    InitQuestion(
        "sound_speed",
        "Sound speed",
        "m/s",
        "Gives each echo its time. 0: no sonar, or the driver gives the times.",
        1500.0,
        maximum=1e4,
    ),
    InitQuestion(
        "interval",
        "Time between pings, of a scanner that of a turn",
        "s",
        "For diagnostics and the estimate below; the tracker measures it.",
        _ping_interval,
        positive=True,
    ),
    InitQuestion(
        "max_speed",
        "Maximum speed of targets",
        "m/s",
        "Swimmer 2, underwater vehicle 5, ship 15; faster targets are not found.",
        COMMON.max_speed,
        maximum=1e4,
        positive=True,
        of_picture=True,
    ),
    InitQuestion(
        "slowest_speed",
        "Speed of the slowest targets, as they move",
        "m/s",
        "What is slower than half of it becomes a fixed echo, no track. 0: what stands is a track.",
        2.0 * COMMON.min_speed,
        maximum=1e4,
        of_picture=True,
    ),
    InitQuestion(
        "extent",
        "Length of targets, of the longest",
        "m",
        "Fish 0.6, diver 2, boat as long as it is: echoes within it are one target's, from the "
        "first ping; so are targets nearer to each other. 0: not known, learned.",
        COMMON.target_extent,
        maximum=1e3,
        of_picture=True,
    ),
    InitQuestion(
        "images",
        "Does your driver publish images, or intensities of single bearings",
        "no or yes",
        "yes: sonar_detector makes the detections of them. no: it publishes detections.",
        0.0,
        choices=("no", "yes"),
    ),
    InitQuestion(
        "rows",
        "Image: what its rows are",
        "auto, ranges, beams or fan",
        "fan: a picture in x and y. auto: ranges, or as the message states it.",
        0.0,
        choices=ROWS,
    ),
    InitQuestion(
        "near_range",
        "Image: range of the nearest row",
        "m",
        "Of sensor_msgs/Image, not the blanking distance; of a fan 0. -1: the messages state it.",
        -1.0,
        minimum=-1.0,
    ),
    InitQuestion(
        "far_range",
        "Image: range of the farthest row",
        "m",
        "As for the nearest row.",
        -1.0,
        minimum=-1.0,
    ),
    InitQuestion(
        "near_row",
        "Image: which row, or of beams which column, is the nearest range",
        "last or first",
        "first: near ranges are at the top, or of beams at the left; of a fan the sonar.",
        0.0,
        choices=("last", "first"),
    ),
    InitQuestion(
        "first_column",
        "Image: side of the first column, or of beams of the first row",
        "port or starboard",
        "As the driver sends it; a display may turn it.",
        0.0,
        choices=("port", "starboard"),
    ),
    InitQuestion(
        "standing",
        "Image: do things that stand still matter",
        "no or yes",
        "no: what stands in the images starts no track; a target that stops keeps its own.",
        0.0,
        choices=("no", "yes"),
        of_picture=True,
    ),
    InitQuestion(
        "false_detections",
        "False detections per ping, over the whole coverage",
        "per ping",
        "Of images the number that is kept, else the start of what is learned. 0: not known.",
        lambda answers: answers["images"] and DetectorOptions().false_detections_per_ping,
        maximum=1e6,
    ),
    InitQuestion(
        "own_ship",
        "Own ship: where the pose of a moving sonar comes from",
        "none, odometry or tf",
        "none: the sonar does not move. tf: also for a sonar that is tilted.",
        0.0,
        choices=OWN_SHIP_SOURCES,
        of_picture=True,
    ),
    *(
        InitQuestion(
            f"mounting_{name}",
            f"Mounting: the sonar {where}",
            unit,
            "With odometry, or of several sensors that do not move; tf has it.",
            0.0,
            minimum=-bound,
            maximum=bound,
        )
        for name, where, unit, bound in MOUNTING
    ),
    InitQuestion(
        "false_tracks",
        "Acceptable false tracks per hour, over the whole coverage",
        "per hour",
        "The only wish: fewer false tracks need more pings to confirm a target.",
        ScoreOptions().false_tracks_per_hour,
        maximum=1e6,
        positive=True,
        of_picture=True,
    ),
)
"""In the order in which they are asked; a default depends on earlier answers only."""


def init_completed(
    given: Answers,
    ask: Callable[[str], str] | None = None,
    first: Answers = MappingProxyType({}),
    *,
    several: bool = False,
) -> dict[str, float]:
    """All answers: those given, checked, and the others asked for, each until it is allowed.

    Parameters
    ----------
    given : mapping of str to float
    ask : callable, optional
        Shows a text and returns the answer; the defaults are taken if not given.
    first : mapping of str to float, optional
        The answers for the first of several sensors: those of the picture, and the defaults of the
        others but the mounting.
    several : bool, optional
        Whether it is one of several sensors, whose mounting counts on a platform at rest, too.

    Raises
    ------
    ValueError
        If a given answer is not allowed, or the input ends; the message names the argument.
    """
    answers: dict[str, float] = {}
    given = {
        **{one.name: first[one.name] for one in QUESTIONS if first and one.of_picture},
        **given,
    }
    for question in QUESTIONS:
        name, default = question.name, question.default(answers)
        is_mounting = name.startswith("mounting")
        default = default if is_mounting else first.get(name, default)
        mounted = (ODOMETRY, AT_REST) if several else (ODOMETRY,)
        if (
            ask is None
            or name in given
            or (is_mounting and answers["own_ship"] not in mounted)
            or (name in OF_IMAGES and not answers["images"])
        ):
            answers[name] = question.checked(given.get(name, default))
        else:
            answers[name] = _asked(question, default, ask)
    return answers


def _asked(question: InitQuestion, default: float, ask: Callable[[str], str]) -> float:
    prompt = (
        f"{question.text} ({question.unit})\n  {question.explanation}\n"
        f"  [{question.shown(default)}]: "
    )
    while True:
        try:
            text = ask(prompt).strip()
        except EOFError:
            raise ValueError(f"no answer to {question.argument}: the input has ended") from None
        try:
            return question.read(text) if text else question.checked(default)
        except ValueError as error:
            print(f"  {error}")


def init_parameters(answers: Answers, *, known_interval: bool = False) -> dict[str, Value]:
    """Parameters of the node `track_initiator` that follow from all answers.

    With a `known_interval` these include the diagnostics of the time between pings.

    Raises
    ------
    ValueError
        If the answers contradict each other; the message has the parameter's name.
    """
    beam, cell = answers["beam_width"], answers["range_cell"]
    if answers["extent"]:
        # The echoes of one target also lie apart by their errors: by a cell of such errors.
        beam = beam or min(answers["bearing_accuracy"] / CELL_TO_STD, math.degrees(1.0))
        cell = cell or min(answers["range_accuracy"] / CELL_TO_STD, 1e4)
    values: dict[str, Value] = {
        "method": "score",
        "sensor.max_range": answers["max_range"],
        "sensor.min_range": answers["min_range"],
        "sensor.azimuth_std": math.radians(answers["bearing_accuracy"]),
        "sensor.azimuth_resolution": math.radians(beam),
        "sensor.range_std": answers["range_accuracy"],
        "sensor.range_std_fraction": answers["range_error"] / 100.0,
        "sensor.range_resolution": cell,
        "sound_speed": answers["sound_speed"],
        "max_speed": answers["max_speed"],
        "target_extent": answers["extent"],
        "score.false_tracks_per_hour": answers["false_tracks"],
        "clutter_density": "estimated",
        "detection_probability": "estimated",
        "own_ship_source": OWN_SHIP_SOURCES[int(answers["own_ship"])],
    }
    if answers["sector"] < ALL_ROUND:
        half = 0.5 * answers["sector"]
        values |= {
            "sensor.azimuth_min": math.radians(answers["sector_centre"] - half),
            "sensor.azimuth_max": math.radians(answers["sector_centre"] + half),
        }
    values |= {
        name: value
        for answer, name, value in (
            ("standing", "start_standing", "on"),
            ("slowest_speed", "min_speed", 0.5 * answers["slowest_speed"]),
        )
        if answers[answer]
    }
    if answers["false_detections"]:
        sensor: SensorModel = make_groups(TRACK_INITIATOR, values)[SensorModel]
        values["sensor.clutter_density"] = answers["false_detections"] / sensor.coverage_area
    for name, _, unit, _ in MOUNTING:
        if answer := answers[f"mounting_{name}"]:
            values[f"mounting.{name}"] = math.radians(answer) if unit == "degrees" else answer
    if known_interval:
        values |= {
            "diagnostics.scan_period": answers["interval"],
            "diagnostics.stale_time": max(MIN_STALE, STALE_PINGS * answers["interval"]),
        }
    values = {
        name: float(f"{value:.6g}") if isinstance(value, float) else value
        for name, value in values.items()
    }
    make_groups(TRACK_INITIATOR, values)
    return values


def init_sections(answers: Answers, values: dict[str, Value]) -> Sections:
    """Sections of the parameter file: values of the tracker, and with images of the detector."""
    if not answers["images"]:
        return {ANY_NODE: values}
    near, far = answers["near_range"], answers["far_range"]
    if max(near, far) >= 0.0 and not 0.0 <= near < far:
        raise ValueError(
            f"--near-range and, above it, --far-range must both be given; got {near:g} and {far:g}"
        )
    number = answers["false_detections"] or DetectorOptions().false_detections_per_ping
    detector: dict[str, Value] = {
        "false_detections_per_ping": number,
        "image.rows": ROWS[int(answers["rows"])],
        "image.near_range": near,
        "image.far_range": far,
        "image.near_first": bool(answers["near_row"]),
        "image.port_first": not answers["first_column"],
        "image.clockwise": False,
        **{name: value for name, value in values.items() if name.startswith(SHARED)},
    }
    check_image_ranges(
        make_groups(SONAR_DETECTOR, detector)[ImageLayout],
        make_groups(TRACK_INITIATOR, values)[SensorModel],
    )
    return {f"{ANY_NODE}/sonar_detector": detector, f"{ANY_NODE}/track_initiator": values}


def init_picture(parts: Mapping[str, Answers], given: Mapping[str, Answers]) -> Sections:
    """Sections of the parameter file of all sensors, by the answers for each.

    Parameters
    ----------
    parts : mapping of str to (mapping of str to float)
        All answers, by the name of the sensor; of a single one the name is empty.
    given : mapping of str to (mapping of str to float)
        Those of them that are no defaults.

    Raises
    ------
    ValueError
        As of `init_parameters` and `init_sections`.
    """
    values = {
        name: init_parameters(answers, known_interval="interval" in given[name])
        for name, answers in parts.items()
    }
    sections = {name: init_sections(answers, values[name]) for name, answers in parts.items()}
    if "" in parts:
        return sections[""]
    named = {
        f"{name}.{key}" if key.startswith(OF_SENSOR) else key: value
        for name, one in values.items()
        for key, value in one.items()
    }
    of_each = tuple(f"{name}." for name in parts)  # after what is of all
    tracker: dict[str, Value] = {"sensors": tuple(parts)}
    tracker |= sorted(named.items(), key=lambda item: item[0].startswith(of_each))
    if STALE in named:
        tracker[STALE] = max(float(str(one.get(STALE, 0.0))) for one in values.values())
    make_groups(TRACK_INITIATOR, tracker)
    detectors = {
        f"{ANY_NODE}/{name}/sonar_detector": detector | {"tracker_sensor": name}
        for name, of_sensor in sections.items()
        if (detector := of_sensor.get(f"{ANY_NODE}/sonar_detector"))
    }
    return {**detectors, f"{ANY_NODE}/track_initiator" if detectors else ANY_NODE: tracker}


def print_methods(options: argparse.Namespace) -> None:
    """List the methods, each with what it is."""
    for name in METHODS:
        print(f"{name}: {str(registered_method(name).__doc__).splitlines()[0].strip()}")


def add_init_arguments(parser: argparse.ArgumentParser) -> None:
    """Add an argument for each question."""
    parser.add_argument("file", nargs="?", default="my_sonar.yaml", help="default my_sonar.yaml")
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: defaults for what is not given"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the file if it exists")
    parser.add_argument(
        "--sensor",
        action="append",
        default=[],
        metavar="NAME",
        help="name of one of several sensors of one picture, once for each; an answer that is not "
        "of all is given as NAME=ANSWER, such as --mounting-yaw port=30",
    )
    for question in QUESTIONS:
        parser.add_argument(
            question.argument,
            dest=question.name,
            action="append",
            default=[],
            metavar="|".join(question.choices)
            or question.unit.upper().replace("%", "PERCENT").replace(" ", "_"),
            help=f"{question.text}, {question.unit}. {question.explanation}".replace("%", "%%"),
        )


def run_init(options: argparse.Namespace) -> None:
    """Ask for the answers that are not given, write the parameter file and say what to expect.

    Nothing is asked where the input or the output is no terminal.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_init_arguments`.

    Raises
    ------
    ValueError
        If an answer is not allowed, or the file exists.
    """
    path = Path(options.file)
    if not path.absolute().parent.is_dir():
        raise ValueError(f"there is no folder for {path}")
    names = InitiatorNodeOptions(sensors=tuple(options.sensor)).sensors
    asks = not options.yes and sys.stdin.isatty() and sys.stdout.isatty()
    if asks:
        print("The sonar's data sheet has most answers. Enter alone takes the value in [ ].\n")
        names = names or _asked_names(input)
    pictures = {
        name: path.with_name("_".join(filter(None, (path.stem, name, "image.png"))))
        for name in names or ("",)
    }
    for file in (path, *pictures.values()):
        if file.exists() and not options.force:
            raise ValueError(f"{file} exists; give another name, or --force to overwrite it")
    given = {name: _given_answers(options, name, names) for name in names or ("",)}
    first: Answers = {}
    for name in given if asks else ():
        print(f"--- {name} ---" * bool(name))
        given[name] = init_completed(given[name], input, first, several=bool(name))
        first = first or given[name]
    parts = {name: init_completed(answers) for name, answers in given.items()}
    content = init_picture(parts, given)
    write_whole_text(path, init_file_text(content, _command_line(path, parts, given)))
    missing = [
        f"  {question.argument} {shown}  ({question.text})"
        for question, shown in _arguments(
            parts, lambda name, question: question.name not in given[name]
        )
    ]
    if missing:
        print(
            "not given"
            + " (without a terminal nothing is asked)" * (not asks and not options.yes)
            + ", defaults taken:",
            *missing,
            sep="\n",
        )
    print(f"{LEARNED}\n")
    for name, answers in parts.items():
        words = [str(path), *["--sensor", name] * bool(name)]
        print(f"{name} alone: " * bool(name), init_expectation_text(answers, words), "\n", sep="")
        if answers["images"] and answers["far_range"] > 0.0:
            detector = "/".join(filter(None, (ANY_NODE, name, "sonar_detector")))
            _draw_layout(pictures[name], make_groups(SONAR_DETECTOR, content[detector]))
    source = OWN_SHIP_SOURCES[int(next(iter(parts.values()))["own_ship"])]
    print(f"written: {path}; run it with", *_run_lines(path, parts, source), sep="\n  ")
    if source == "none":
        print("on a moving vessel give --own-ship odometry, or tf")


def _asked_names(ask: Callable[[str], str]) -> tuple[str, ...]:
    """Names of several sensors of one picture; empty for a single one."""
    while True:
        names = ask(NAMES_PROMPT).replace(",", " ").split()
        try:
            return InitiatorNodeOptions(sensors=tuple(names)).sensors
        except ValueError as error:
            print(f"  {error}")


def _given_answers(options: argparse.Namespace, name: str, names: Sequence[str]) -> Answers:
    """Answers of the command line for a sensor: those of all, and NAME=ANSWER."""
    given: dict[str, float] = {}
    for question in QUESTIONS:
        for text in sorted(getattr(options, question.name), key=lambda text: "=" in text):
            front, _, answer = text.rpartition("=")
            if front and (question.of_picture or front not in names):
                why = OF_PICTURE if front in names else f"{front} is no --sensor"
                raise ValueError(f"{question.argument} {text}: {why}")
            if front in ("", name):
                given[question.name] = question.read(answer)
    return given


def _arguments(
    parts: Mapping[str, Answers], wanted: Callable[[str, InitQuestion], bool]
) -> list[tuple[InitQuestion, str]]:
    """Questions with an answer as the command takes it: once if it is that of all sensors."""
    found = []
    for question in QUESTIONS:
        shown = {
            name: question.shown(answers[question.name])
            for name, answers in parts.items()
            if (answers["images"] or question.name not in OF_IMAGES) and wanted(name, question)
        }
        if len({*shown.values()}) == 1 and (question.of_picture or len(shown) == len(parts)):
            shown = {"": next(iter(shown.values()))}
        found += [(question, f"{name}={text}" if name else text) for name, text in shown.items()]
    return found


def _run_lines(path: Path, parts: Mapping[str, Answers], source: str) -> list[str]:
    """Commands that run the nodes: a detector for each sensor with images, and the tracker."""
    more = {"odometry": " -r own_ship/odometry:=YOUR_ODOMETRY", "tf": " -p fixed_frame:=map"}
    file, last = f"--params-file {shlex.quote(str(path))}", more.get(source, "")
    detectors = [
        f"sonar_detector --ros-args{f' -r __ns:=/{name}' * bool(name)} {file} -r image:=YOUR_TOPIC"
        for name, answers in parts.items()
        if answers["images"]
    ]
    topics = [
        f" -r {'/'.join(filter(None, (name, 'detections')))}:=YOUR_TOPIC"
        for name, answers in parts.items()
        if not answers["images"]
    ]
    nodes = [*detectors, f"track_initiator --ros-args {file}{''.join(topics)}"]
    return [f"ros2 run tsepm_ros {node}{last}" for node in nodes]


def _draw_layout(path: Path, groups: Mapping[type[Any], Any]) -> None:
    """Picture of where an image has its ranges and sides, as `sonar_detector` reads it."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        print("no picture of the image: it needs matplotlib, see the extra plot")
        return
    layout, sensor = groups[ImageLayout], groups[Coverage]
    ends, sector = (layout.near_range, layout.far_range), (sensor.azimuth_min, sensor.azimuth_max)
    half = 0.5 * (sector[1] - sector[0])
    of_fan = 1.0 if half > 0.5 * math.pi else 2.0 * math.sin(half)
    shape = 300, round(300 * (of_fan if layout.rows == "fan" else 1.5))
    rows, columns = np.indices(shape, float)
    range_, azimuth, down = located_image(rows, layout, ends, sector)
    across = located_image(columns, layout, ends, sector)[2]
    ahead, port = (range_ * turn(azimuth)[:, None] for turn in (np.cos, np.sin))
    figure = Figure(figsize=(13, 7), layout="constrained")
    words = image_in_words(rows, layout, range_, azimuth).partition(": ")[2]
    figure.suptitle(textwrap.fill(words, 110))
    (b, m), to_port = down.shape, np.argsort(azimuth)
    beam, cell, arcs = to_port[b * 3 // 4], m * 3 // 4, np.linspace(0, m - 1, 5).round().astype(int)
    target = f"a target at {range_[cell]:.3g} m, {image_side_in_words(azimuth[beam])}"
    for axes, x, y, title in zip(
        figure.subplots(1, 2),
        (across, -port),
        (down, ahead),
        ("the image as the driver sends it\n", "from above, m: ahead is up, port is at the left\n"),
        strict=True,
    ):
        axes.plot(x[:, arcs], y[:, arcs], color="grey", lw=1)
        for k in arcs:
            axes.text(x[b // 2, k], y[b // 2, k], f"{range_[k]:.3g} m", ha="center", va="bottom")
        for side, colour in zip(to_port[[0, -1]], ("green", "red"), strict=True):
            axes.plot(
                x[side], y[side], color=colour, lw=4, label=image_side_in_words(azimuth[side])
            )
        axes.plot(x[beam, cell], y[beam, cell], "*", color="black", ms=14, label=target)
        axes.set(title=title, aspect="equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06))
    figure.axes[0].set(
        xlim=(-0.5, shape[1] - 0.5),
        ylim=(shape[0] - 0.5, -0.5),
        xticks=(0, shape[1] - 1),
        xticklabels=["first column", "last column"],
        yticks=(0, shape[0] - 1),
        yticklabels=["first row", "last row"],
    )
    write_whole_picture(path, figure)
    print(f"picture: {path}; compare it with the driver's own display")


def init_file_text(content: Sections, line: str) -> str:
    """The parameter file, for nodes in any namespace; without images of any name."""
    lines = [
        f"# {line}",
        "# Clutter density and detection probability are learned; a density here is the start.",
    ]
    for key, values in content.items():
        lines += parameter_file_section(key) + [
            f"    {name}: {parameter_file_text(value)}" for name, value in values.items()
        ]
    return "\n".join(lines) + "\n"


def init_expectation_text(answers: Answers, file: Sequence[str]) -> str:
    """Table of the estimated performance by the number of false detections; a more exact way.

    If that number is not given, for each of `FALSE_DETECTIONS`. Targets have half the maximum
    speed; detection probability 0.9. `file` are the words of the file.
    """
    interval, given = answers["interval"], answers["false_detections"]
    groups = make_groups(TRACK_INITIATOR, init_parameters(answers))
    sensor, rows = groups[SensorModel], []
    for number in (given,) if given else FALSE_DETECTIONS:
        case = PredictionCase(
            sensor=replace(sensor, clutter_density=number / sensor.coverage_area),
            common=groups[CommonOptions],
            interval=interval,
            scans=ESTIMATED_SCANS,
            target_speed=0.5 * answers["max_speed"],
        )
        estimate = first_prediction(case, groups[ScoreOptions], given_window=True)
        row = [f"{number:g}"]
        for share in (0.5, 0.9):
            scans = estimate.scans_until(share)
            row += ["-", "-"] if scans is None else [f"{scans}", f"{(scans - 1) * interval:.3g} s"]
        rows.append(row)
    head = [
        "false detections per ping",
        "half found in pings",
        "time",
        "0.9 found in pings",
        "time",
    ]
    return (
        f"what to expect at {answers['false_tracks']:g} false tracks per hour, by theory,\n"
        f"of targets at {0.5 * answers['max_speed']:g} m/s, seen in 9 of 10 pings, a ping every "
        f"{interval:g} s (a dash: not within {ESTIMATED_SCANS} pings)\n"
        f"{terminal_table(head, rows)}\n"
        "more exact, with a required share of targets found: "
        f"tsepm design --params-file {shlex.join(file)} --interval {interval:g}"
        + ("" if answers["false_detections"] else " --false-detections YOURS")
    )


def _command_line(path: Path, parts: Mapping[str, Answers], given: Mapping[str, Answers]) -> str:
    """The command line that writes the same file again: an interval only if it was given."""
    words = ["tsepm", "init", str(path), "--yes"]
    for name in filter(None, parts):
        words += ["--sensor", name]
    for question, shown in _arguments(
        parts, lambda name, question: question.name != "interval" or question.name in given[name]
    ):
        words += [question.argument, shown]
    return shlex.join(words)
