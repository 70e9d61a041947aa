"""Start and clean shutdown of a node."""

from __future__ import annotations

import math
import signal
import sys
import time
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Future

from tsepm_ros.ending_signals import ENDING_SIGNALS
from tsepm_ros.nodes.node_parameters import ParameterError

EXIT_BAD_PARAMETER = 2
HELP = ("--help", "-h")
MAX_STANDING = 5.0
"""Time of the wall clock after which the clock of a node stands still, s."""


def clock_time(node: Node) -> float:
    """Time of a node's clock, s, which may be simulated."""
    return float(node.get_clock().now().nanoseconds * 1e-9)


class NodeClocks:
    """The times that limit waiting: wall clock and node clock, which may be simulated.

    Parameters
    ----------
    node : Node
    warn : callable
        Called as ``warn(reason, sentence, 0)``.

    Attributes
    ----------
    fault : str
        A sentence while the node clock stands still, which limits nothing: its time is nan then.
    """

    def __init__(self, node: Node, warn: Callable[[str, str, int], None]) -> None:
        self._clock, self._warn, self.fault = node.get_clock(), warn, ""
        self._time, self._since = math.nan, 0.0

    def now(self) -> tuple[float, float]:
        """Times of the wall clock and the node clock, s."""
        wall, simulated = time.monotonic(), self._clock.now().nanoseconds * 1e-9
        if simulated != self._time:
            self._time, self._since, self.fault = simulated, wall, ""
        if wall - self._since <= MAX_STANDING:
            return wall, simulated
        self.fault = (
            f"the node's clock (use_sim_time) stands still for {wall - self._since:.3g} s: is "
            "/clock published? Waiting is limited by the wall clock"
        )
        self._warn("clock", self.fault, 0)
        return wall, math.nan


def run(make_node: Callable[[], Node], args: Sequence[str] | None = None, usage: str = "") -> int:
    """Run a node until it is interrupted, or until its future `finished`, if any, is done.

    Parameters
    ----------
    make_node : callable
        Returns the node.
    args : sequence of str, optional
        Command-line arguments; those of the process if not given.
    usage : str, optional
        Text for the argument ``--help`` or ``-h``, which prints it before ROS starts.

    Returns
    -------
    int
        Exit code: 0 after SIGINT, SIGTERM, the node's own end or ``--help``; 2 for a refused
        argument or parameter.
    """
    given = sys.argv[1:] if args is None else args
    if not set(HELP).isdisjoint(given):
        print(usage)
        return 0
    stray = _stray_argument(given)
    if stray:
        print(
            f"refused: {stray!r} is not an argument of this program; parameters and remappings "
            "follow --ros-args, such as --ros-args -p max_speed:=5.0 (--help explains)",
            file=sys.stderr,
        )
        return EXIT_BAD_PARAMETER
    # No KeyboardInterrupt, which can be raised anywhere: a signal shuts rclpy's context down. The
    # list holds signals that arrive before the context exists.
    signals: list[int] = []
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda number, _: signals.append(number))
    try:
        try:
            rclpy.init(args=args)
        except RuntimeError as error:
            print(f"refused: {error}", file=sys.stderr)
            return EXIT_BAD_PARAMETER
        return 0 if signals else _run(make_node)
    finally:
        rclpy.try_shutdown()
        for number in ENDING_SIGNALS:
            # The interpreter restores its own handlers before it ends, but keeps SIG_IGN.
            signal.signal(number, signal.SIG_IGN)


def _stray_argument(arguments: Sequence[str]) -> str:
    """The first option outside of ``--ros-args ... --``, which ROS would ignore; may be empty."""
    to_ros = False
    for argument in arguments:
        if argument in ("--ros-args", "--"):
            to_ros = argument == "--ros-args"
        elif not to_ros and (argument.startswith("-") or ":=" in argument):
            return argument
    return ""


def _run(make_node: Callable[[], Node]) -> int:
    try:
        # Before the node, which takes longer: a signal during its construction prints a traceback.
        executor = SingleThreadedExecutor()
        try:
            _spin(executor, _made(make_node))
        finally:
            executor.shutdown()
    except ParameterError as error:
        print(f"refused: {error}", file=sys.stderr)
        return EXIT_BAD_PARAMETER
    except Exception:
        # A signal may invalidate the context at any point; that end is clean.
        if rclpy.ok():
            raise
    return 0


def _made(make_node: Callable[[], Node]) -> Node:
    """Make the node; what the middleware refuses, such as security without keys, is refused."""
    try:
        return make_node()
    except rclpy_implementation.RCLError as error:
        if not rclpy.ok():
            raise
        raise ParameterError(" ".join(str(error).split())) from error


def _spin(executor: SingleThreadedExecutor, node: Node) -> None:
    executor.add_node(node)
    finished: Future | None = getattr(node, "finished", None)
    try:
        if finished is None:
            executor.spin()
        else:
            executor.spin_until_future_complete(finished)
    finally:
        node.destroy_node()
