"""Worker processes end with the process that started them."""

import os
import signal
import subprocess
import sys
import time

import pytest
from support.patience import WAIT

SCRIPT = """
import os, sys, time
from tsepm_ros.tools.evaluation.workers import Workers

def busy(job):
    os.write(1, b"%d\\n" % os.getpid())  # in one piece
    time.sleep(3600)

if __name__ == "__main__":
    list(Workers(processes=2).mapped(busy, range(4)))
"""


def is_alive(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs /proc")
def test_workers_of_a_killed_parent_end(tmp_path):
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    workers: list[int] = []
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as run:
        try:
            workers += [int(run.stdout.readline()) for _ in range(2)]
            assert all(is_alive(worker) for worker in workers)
            run.kill()
            run.wait()
            end = time.monotonic() + WAIT
            while any(is_alive(worker) for worker in workers) and time.monotonic() < end:
                time.sleep(0.05)
            assert not any(is_alive(worker) for worker in workers)
        finally:
            run.kill()
            for worker in filter(is_alive, workers):
                os.kill(worker, signal.SIGKILL)


WHILE_THEY_START = """
import os, signal, time
from tsepm_ros.tools.evaluation.workers import Workers

def wait(job):
    time.sleep(0.001)

def end(number, frame):
    raise SystemExit(40 + number)

if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    ended = iter([signal.{name}])
    os.register_at_fork(before=lambda: [os.kill(os.getpid(), number) for number in ended])
    list(Workers(processes=2).mapped(wait, range(4)))
"""


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_workers_start_is_not_lost(tmp_path, number):
    script = tmp_path / "run.py"
    script.write_text(WHILE_THEY_START.format(name=number.name))
    ended = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=WAIT
    )
    assert (ended.returncode, ended.stderr) == (40 + number, "")
