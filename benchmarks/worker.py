"""A contender's own process: takes scans on standard input, answers on standard output.

Started by `race`, not by hand.
"""

from __future__ import annotations

import os
import pickle
import sys
import time
from typing import Any

from contenders import make_contender


def main() -> None:
    """Make the contender that comes first on standard input, then process one scan per message."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get between the answers

    def answer(value: dict[str, Any]) -> None:
        pickle.dump(value, answers)
        answers.flush()

    name, sea = pickle.load(sys.stdin.buffer)
    try:
        contender = make_contender(name, sea)
    except ImportError as error:
        answer({"missing": str(error)})
        return
    answer({})
    while (scan := pickle.load(sys.stdin.buffer)) is not None:
        cpu, begin = time.process_time(), time.perf_counter()
        new = contender.process(scan)
        seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
        counts = {"detections": len(scan), **contender.counts(), "confirmed": new}
        tracks = {"hits": contender.hits(), "states": contender.states()}
        answer({"seconds": seconds, "cpu": cpu, "counts": counts, **tracks})


if __name__ == "__main__":
    main()
