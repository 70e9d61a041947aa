"""The offline command `tsepm`: methods, parameters, recordings and studies without ROS."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence

from tsepm_ros.commands.design_command import add_design_arguments, run_design
from tsepm_ros.commands.evaluate_command import add_evaluation_arguments, run_evaluation
from tsepm_ros.commands.reproduce_command import add_reproduction_arguments, run_reproduction
from tsepm_ros.commands.run_command import add_recording_arguments, run_recording
from tsepm_ros.methods.registry import METHODS
from tsepm_ros.settings.rendering import as_markdown, as_page, as_yaml
from tsepm_ros.settings.tables import NODES

INTERRUPTED = 130
"""What a shell takes for ended by an interrupt."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Returns
    -------
    int
        0; 2 with a sentence on stderr where something given is not allowed; 1 where a file cannot
        be read or written; 130 if interrupted.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(arguments)
    options.line = shlex.join(["tsepm", *arguments])
    try:
        options.command(options)
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        print(f"failed: {error}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="tsepm", description="Track initiation without ROS.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    one = commands.add_parser("methods", help="list the methods")
    one.set_defaults(command=_methods)

    one = commands.add_parser("parameters", help="print the parameters of a node, with defaults")
    one.add_argument("node", nargs="?", choices=[*sorted(NODES), "all"], default="track_initiator")
    one.add_argument("--markdown", action="store_true", help="tables instead of YAML")
    one.set_defaults(command=_parameters)

    one = commands.add_parser(
        "run",
        help="start tracks on a recording, a bag or a simulated scenario; as CSV, or a picture",
    )
    add_recording_arguments(one)
    _add_parameters(one)
    one.set_defaults(command=run_recording)

    one = commands.add_parser(
        "design", help="what a sonar and a wish lead to: thresholds, rules, what is found and when"
    )
    add_design_arguments(one)
    _add_parameters(one)
    one.set_defaults(command=run_design)

    # What was the command `study`; it names the new one until the next release.
    one = commands.add_parser("study", prefix_chars="+", add_help=False)
    one.add_argument("given", nargs="*")
    one.set_defaults(command=_study)

    one = commands.add_parser(
        "evaluate", help="operating curves of the methods: tables and pictures from many runs"
    )
    add_evaluation_arguments(one)
    one.set_defaults(command=_evaluate)

    one = commands.add_parser(
        "reproduce", help="what the sources publish, regenerated beside the published values"
    )
    add_reproduction_arguments(one)
    one.set_defaults(command=_reproduce)
    return parser


def _add_parameters(
    parser: argparse.ArgumentParser, text: str = "parameter as of the node track_initiator"
) -> None:
    parser.add_argument(
        "-p", "--parameter", action="append", default=[], metavar="NAME:=VALUE", help=text
    )


def _methods(options: argparse.Namespace) -> None:
    rows = [[name, str(kind.__doc__).splitlines()[0].strip()] for name, kind in METHODS.items()]
    for name, text in rows:
        print(f"{name}: {text}")


def _parameters(options: argparse.Namespace) -> None:
    if options.node == "all":
        every = "\n".join(as_yaml(node, groups) for node, groups in NODES.items())
        print(as_page(NODES) if options.markdown else every, end="")
        return
    groups = NODES[options.node]
    print(as_markdown(groups) if options.markdown else as_yaml(options.node, groups), end="")


def _study(options: argparse.Namespace) -> None:
    raise ValueError(
        "tsepm study is now a point of tsepm evaluate: "
        "tsepm evaluate SCENARIO --method METHOD -p OPTION:=VALUE"
    )


def _evaluate(options: argparse.Namespace) -> None:
    run_evaluation(options, options.line)


def _reproduce(options: argparse.Namespace) -> None:
    run_reproduction(options, options.line)


if __name__ == "__main__":
    raise SystemExit(main())
