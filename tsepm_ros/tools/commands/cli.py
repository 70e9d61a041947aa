"""The offline command `tsepm`: methods, parameters, recordings and studies without ROS."""

from __future__ import annotations

import argparse
import math
import os
import pkgutil
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tsepm_ros.diagnostics.health_figures import ORDER, Level
from tsepm_ros.ending_signals import INTERRUPTED, ending_on_termination
from tsepm_ros.methods.registry import METHODS, method_class
from tsepm_ros.settings.parameter_files import ANY_NODE, as_yaml
from tsepm_ros.settings.settings import NODES
from tsepm_ros.tools.commands.arguments import CommandFailed
from tsepm_ros.tools.commands.design_command import add_design_arguments, run_design
from tsepm_ros.tools.commands.detect_command import add_detect_arguments, run_detect
from tsepm_ros.tools.commands.evaluate_command import add_evaluation_arguments, run_evaluation
from tsepm_ros.tools.commands.init_command import add_init_arguments, run_init
from tsepm_ros.tools.commands.run_command import (
    add_recording_arguments,
    add_watch_arguments,
    run_recording,
    run_watch,
)
from tsepm_ros.tools.replay.bag import ROLES
from tsepm_ros.whole_files import naming

AddArguments = Callable[[argparse.ArgumentParser], None]
Command = Callable[[argparse.Namespace], None]

REPRODUCTION = "tsepm_ros.studies.reproduction.report"
MAX_SENTENCE = 800
"""Most characters of an error's sentence."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns
    -------
    int
        0; 2 with a message on stderr if an argument is not allowed; 1 if a file cannot be read or
        written, or every scan was dropped; 130 if interrupted, 143 if terminated.
    """
    with ending_on_termination():
        return _run(sys.argv[1:] if arguments is None else arguments)


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    options.line = shlex.join(["tsepm", *arguments])
    try:
        with naming("standard output"):
            options.command(options)
            sys.stdout.flush()
    except ValueError as error:
        print(f"refused: {_sentence(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
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
    return text if len(text) <= MAX_SENTENCE else f"{text[:MAX_SENTENCE]} ..."


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="tsepm", description="Track initiation without ROS.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, (text, add_arguments, function) in COMMANDS.items():
        command = commands.add_parser(name, help=text)
        add_arguments(command)
        command.set_defaults(command=function)
    return parser


def _reproduction(name: str) -> Any:
    """A function of the studies, which tools do not import."""
    return pkgutil.resolve_name(f"{REPRODUCTION}:{name}")


def _methods(options: argparse.Namespace) -> None:
    for name in METHODS:
        print(f"{name}: {str(method_class(name).__doc__).splitlines()[0].strip()}")


def _add_parameters_arguments(parser: argparse.ArgumentParser) -> None:
    names = [*sorted(NODES), "all"]
    parser.add_argument("node", nargs="?", choices=names, default="track_initiator")


def _parameters(options: argparse.Namespace) -> None:
    nodes = NODES if options.node == "all" else {options.node: NODES[options.node]}
    keys = {node: ANY_NODE if len(nodes) == 1 else f"{ANY_NODE}/{node}" for node in nodes}
    files = [as_yaml(node, groups, keys[node]) for node, groups in nodes.items()]
    print("\n".join(files), end="")


def _add_ros_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=[], help="arguments of ROS, such as -r"
    )


def _add_health_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("node", nargs="?", default="", help="full name; default every node")
    parser.add_argument("--timeout", type=float, default=5.0, help="longest time, s; default 5")
    _add_ros_arguments(parser)


def _live(make: str, options: argparse.Namespace, *arguments: Any) -> Any:
    """Run a node of the commands on live topics to its end, and return it."""
    try:
        from tsepm_ros.nodes.base_node import run

        kind = pkgutil.resolve_name(f"tsepm_ros.tools.live_commands:{make}")
    except ImportError as error:
        raise ValueError(f"live topics need ROS 2 ({error})") from None
    made: list[Any] = []

    def make_node() -> Any:
        made.append(kind(*arguments))
        return made[0]

    code = run(make_node, ["--ros-args", *options.ros_args])
    if code:
        raise SystemExit(code)
    return made[0]


def _health(options: argparse.Namespace) -> None:
    if not 0.0 < options.timeout < math.inf:
        raise ValueError("--timeout must be a positive number of seconds")
    entries = _live("HealthReader", options, options.node, options.timeout).entries
    for level, sentence in entries:
        print(f"{level.name:5} {sentence}")
    if not entries:
        print(f"no node was heard within {options.timeout:g} s", file=sys.stderr)
        raise SystemExit(int(Level.STALE))
    raise SystemExit(int(max((level for level, _ in entries), key=ORDER.index)))


def _add_record_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="folder of the bag, which must not exist")
    names = (*ROLES, "/tf", "/tf_static")
    parser.add_argument(
        "topics", nargs="*", default=names, help=f"default the inputs: {', '.join(names)}"
    )
    _add_ros_arguments(parser)


def _record(options: argparse.Namespace) -> None:
    counts = _live("TopicRecorder", options, options.out, options.topics).counts
    print("\n".join(f"{topic}: {number} messages" for topic, number in counts.items()))


COMMANDS: dict[str, tuple[str, AddArguments, Command]] = {
    "methods": ("list the methods", lambda parser: None, _methods),
    "parameters": (
        "print the parameters of a node, with defaults",
        _add_parameters_arguments,
        _parameters,
    ),
    "init": (
        "ask what a sonar is, write the node's parameter file and estimate the performance",
        add_init_arguments,
        run_init,
    ),
    "detect": (
        "detect targets in a folder of sonar images; write CSV, or a picture of one image",
        add_detect_arguments,
        run_detect,
    ),
    "run": (
        "start tracks on a recording, a bag or a simulated scenario; write CSV or a picture",
        add_recording_arguments,
        run_recording,
    ),
    "watch": (
        "show live topics, a recording, a bag or a simulated scenario on a page in a browser",
        add_watch_arguments,
        run_watch,
    ),
    "health": (
        "print the health of the running nodes; the exit code is that of the worst level",
        _add_health_arguments,
        _health,
    ),
    "record": (
        "write a bag of live topics until interrupted, without ros2 bag",
        _add_record_arguments,
        _record,
    ),
    "design": (
        "predict detection and false tracks of a sonar at a target false-track rate",
        add_design_arguments,
        run_design,
    ),
    "evaluate": (
        "operating curves of the methods: tables and pictures from many runs",
        add_evaluation_arguments,
        run_evaluation,
    ),
    "reproduce": (
        "regenerate the published results and compare them with the published values",
        lambda parser: _reproduction("add_reproduction_arguments")(parser),
        lambda options: _reproduction("run_reproduction")(options),
    ),
}
"""Description, arguments and function of each command."""


if __name__ == "__main__":
    raise SystemExit(main())
