"""The command `tsepm watch`: live topics or a recording on a page in a browser."""

from __future__ import annotations

import argparse
import threading
from contextlib import ExitStack, suppress

from tsepm_ros.parameters import Value, table
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.settings.parameter_files import yaml_text
from tsepm_ros.tools.commands.run_command import add_source_arguments, open_run
from tsepm_ros.tools.terminal import with_progress
from tsepm_ros.tools.viewer.serving import make_server

OPTIONS = ("host", "port", "token")
"""Options of the server that are arguments too."""


def add_watch_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tsepm watch`."""
    add_source_arguments(parser, nargs="?")
    for row in table(ViewerNodeOptions):
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
    parser.set_defaults(out=None, picture=None, animation=None, html=True)


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
    parameters = [part for name, value in given.items() for part in _assignment(name, value)]
    code = main(["--ros-args", *parameters, *options.ros_args])
    if code:
        raise SystemExit(code)


def _assignment(name: str, value: Value) -> tuple[str, str]:
    return "-p", f"{name}:={yaml_text(value)}"


def _watch_recording(options: argparse.Namespace, viewer: ViewerNodeOptions) -> None:
    if options.ros_args:
        raise ValueError("--ros-args is for live topics, and a recording is given")
    with ExitStack() as stack:
        run = open_run(options, stack)
        recorded = run.recorded_scene()
        server = make_server(viewer, recorded.title)  # before the work: the port may be in use
        stack.callback(server.stop)
        for result in with_progress(run.results, run.scans, "scans", "scan"):
            recorded.add(result, run.session.tracker)
        server.start(run.page_of(recorded))
        print(f"{len(recorded)} scans; open {server.url} (Ctrl-C ends)", flush=True)
        with suppress(KeyboardInterrupt):
            ended = threading.Event()
            while not ended.wait(1.0):  # looks again: another thread may have got the signal
                pass
