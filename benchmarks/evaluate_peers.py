"""The evaluation of `tsepm evaluate` with the peers in the same tables and pictures.

Peers start tracks and hold none here, and norfair tells no covariance: what needs these is left out
for them.

    python benchmarks/evaluate_peers.py box --runs 100 --horizon 8
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

from peers import PEERS, peer_points

from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.commands.evaluate_command import add_evaluation_arguments, run_evaluation


def installed(peers: list[str]) -> list[OperatingPoint]:
    """The sweeps of those peers whose package is there; of the others it is said."""
    points = []
    for peer in peers:
        try:
            points += peer_points(peer)
        except ImportError as error:
            print(f"{peer} left out: {error}", file=sys.stderr)
    return points


def main() -> int:
    """Evaluate, print and write; 2 where something given is not allowed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_evaluation_arguments(parser)
    parser.add_argument("--peer", action="append", choices=PEERS, help="default: every peer")
    options = parser.parse_args()
    options.line = shlex.join(["python", "benchmarks/evaluate_peers.py", *sys.argv[1:]])
    try:
        run_evaluation(options, installed(options.peer or list(PEERS)))
    except ValueError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
