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
"""The offline command `tsepm`: methods, parameters, recordings and studies without ROS."""

from __future__ import annotations

import argparse
import io
import math
import os
import pkgutil
import shlex
import sys
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tsepm_ros.diagnostics.health_figures import ORDER, Level
from tsepm_ros.ending_signals import (
    INTERRUPTED,
    ending_on_termination,
    ends_at_once,
    handling_ending_signals,
)
from tsepm_ros.tools.commands.arguments import Arguments, CommandFailed, add_arguments
from tsepm_ros.whole_files import file_error_sentence, naming_file

Place = str | Callable[..., Any]
"""A function, or its module and name: the modules are imported when the command is called."""
HERE = "tools.commands"
FAULT = 70
"""Exit code after a fault of the package, EX_SOFTWARE of sysexits.h."""
REPORT = (
    "This is a fault of tsepm: set TSEPM_DEBUG=1, repeat the command, and report both to the "
    "maintainers"
)
ROS_ARGUMENTS: Arguments = {
    "--ros-args": {
        "nargs": argparse.REMAINDER,
        "default": [],
        "help": "arguments of ROS, such as -r",
    }
}
HEALTH_ARGUMENTS: Arguments = {
    "node": {"nargs": "?", "default": "", "help": "full name; default every node"},
    "--timeout": {"type": float, "default": 5.0, "help": "longest time, s; default 5"},
    **ROS_ARGUMENTS,
}
MAX_SENTENCE = 800
"""Most characters of an error's sentence."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns
    -------
    int
        0; 2 with a message on stderr if an argument is not allowed; 1 if a file cannot be read or
        written, or there was no scan; 70 after a fault of the package, whose traceback is printed
        with TSEPM_DEBUG in the environment; 130 if interrupted, 143 if terminated.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # names of files may be no UTF-8
    try:
        with ending_on_termination():
            return _run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if os.environ.get("TSEPM_DEBUG"):
            raise
        print(f"failed: {_sentence(error)} ({type(error).__name__}). {REPORT}", file=sys.stderr)
        return FAULT


def _run(arguments: Sequence[str]) -> int:
    options = _parser(arguments[:1]).parse_args(arguments)
    options.line = shlex.join(["tsepm", *arguments])
    try:
        with naming_file("standard output"):
            _function(options.command)(options)
            sys.stdout.flush()
    except ValueError as error:
        print(f"refused: {_sentence(error)}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader, such as head, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, CommandFailed) as error:
        if "standard output" in str(error):  # Python writes what is left at its end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"failed: {_sentence(error)}", file=sys.stderr)
        return 1
    return 0


def _sentence(error: Exception) -> str:
    """What an error says, on one line and of bounded length: it may quote a whole file."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, OSError) and error.filename is not None:
        text = f"{error.filename} cannot be used: {file_error_sentence(error)}"
    return text if len(text) <= MAX_SENTENCE else f"{text[:MAX_SENTENCE]} ..."


def _parser(named: Collection[str] | None = None) -> argparse.ArgumentParser:
    """The parser of all commands, of which those named, or all, have their arguments.

    The modules of a command are imported where they are needed: all take seconds.
    """
    parser = argparse.ArgumentParser(prog="tsepm", description="Track initiation without ROS.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, (text, arguments, function) in COMMANDS.items():
        command = commands.add_parser(name, help=text)
        if named is None or name in named:
            given = _function(arguments)
            given(command) if callable(given) else add_arguments(command, given)
        command.set_defaults(command=function)
    return parser


def _function(function_place: Place | Arguments) -> Any:
    """A function or a table of the commands, or one of another module, which is imported."""
    if not isinstance(function_place, str):
        return function_place
    with handling_ending_signals(ends_at_once()):
        return pkgutil.resolve_name(f"tsepm_ros.{function_place}")


def _of_ros(*places: str) -> list[Callable[..., Any]]:
    """Functions of modules that need ROS."""
    try:
        return [_function(place) for place in places]
    except ImportError as error:
        raise ValueError(f"live topics need ROS 2 ({error})") from None


def _health(options: argparse.Namespace) -> None:
    if not 0.0 < options.timeout < math.inf:
        raise ValueError("--timeout must be a positive number of seconds")
    [read] = _of_ros("tools.live_commands:read_live_health")
    entries = read(options.node, options.timeout, options.ros_args)
    for level, sentence in entries:
        print(f"{level.name:5} {sentence}")
    if not entries:
        print(f"no node was heard within {options.timeout:g} s", file=sys.stderr)
        raise SystemExit(int(Level.STALE))
    raise SystemExit(int(max((level for level, _ in entries), key=ORDER.index)))


def _add_record_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="folder of the bag, which must not exist")
    names = (*pkgutil.resolve_name("tsepm_ros.tools.replay.bag:ROLES"), "/tf", "/tf_static")
    parser.add_argument(
        "topics",
        nargs="*",
        help=f"default the inputs: {', '.join(names)}; and of several sensors NAME/detections "
        "and their images, as the running node says",
    )
    parser.set_defaults(inputs=names)
    add_arguments(parser, ROS_ARGUMENTS)


def _record(options: argparse.Namespace) -> None:
    run, recorder = _of_ros(
        "nodes.base_node:run_node", "tools.players.scan_player:PlayerTopicRecorder"
    )
    topics, with_sensors = options.topics or options.inputs, not options.topics
    make = partial(recorder, options.out, topics, with_sensors=with_sensors)
    if code := run(make, ["--ros-args", *options.ros_args]):
        raise SystemExit(code)


COMMANDS: dict[str, tuple[str, Place | Arguments, Place]] = {
    "methods": ("list the methods", {}, f"{HERE}.init_command:print_methods"),
    "parameters": (
        "print the parameters of a node, with defaults",
        f"{HERE}.given_parameters:ARGUMENTS",
        f"{HERE}.given_parameters:print_parameters",
    ),
    "init": (
        "ask what a sonar is, write the node's parameter file and estimate the performance",
        f"{HERE}.init_command:add_init_arguments",
        f"{HERE}.init_command:run_init",
    ),
    "detect": (
        "detect targets in a folder of sonar images; write CSV, or a picture of one image",
        f"{HERE}.detect_command:add_detect_arguments",
        f"{HERE}.detect_command:run_detect",
    ),
    "run": (
        "start tracks on a recording, a bag or a simulated scenario; write CSV or a picture",
        f"{HERE}.run_command:add_run_arguments",
        f"{HERE}.run_command:run_recording",
    ),
    "watch": (
        "show live topics, a recording, a bag or a simulated scenario on a page in a browser",
        f"{HERE}.run_command:add_watch_arguments",
        f"{HERE}.run_command:run_watch",
    ),
    "simulate": (
        "write a recording of a scenario, of several sensors one of each, and their parameters",
        f"{HERE}.run_command:SIMULATE_ARGUMENTS",
        f"{HERE}.run_command:run_simulate",
    ),
    "health": (
        "print the health of the running nodes; the exit code is that of the worst level",
        HEALTH_ARGUMENTS,
        _health,
    ),
    "record": (
        "write a bag of live topics until interrupted, without ros2 bag",
        _add_record_arguments,
        _record,
    ),
    "design": (
        "predict detection and false tracks of a sonar at a target false-track rate",
        f"{HERE}.design_command:add_design_arguments",
        f"{HERE}.design_command:run_design",
    ),
    "evaluate": (
        "operating curves of the methods: tables and pictures from many runs",
        f"{HERE}.evaluate_command:add_evaluate_arguments",
        f"{HERE}.evaluate_command:run_evaluate",
    ),
    "score": (
        "compare tracks with the truth, two CSV files: OSPA, GOSPA and CLEAR-MOT",
        f"{HERE}.score_command:ARGUMENTS",
        f"{HERE}.score_command:run_score",
    ),
    "reproduce": (
        "regenerate the published results and compare them with the published values",
        "studies.reproduction.report:add_report_arguments",
        "studies.reproduction.report:run_report",
    ),
}
"""Description, arguments, or what adds them, and function of each command."""


if __name__ == "__main__":
    raise SystemExit(main())
