"""Worker processes: order, errors, death, and their end with the parent."""

import math
import operator
import os
import signal
import subprocess
import sys
import time

import pytest

from roundel.datasets.worker_pool import in_order
from roundel.scenes.errors import DataError

# Functions of the standard library, because a worker cannot import a test module.
NOTHING = (operator.not_, (0,), "a worker died")


def test_results_come_in_the_order_of_the_items() -> None:
    assert list(in_order(2, math.factorial, range(30), *NOTHING)) == [math.factorial(i) for i in range(30)]


def test_errors_of_the_work_and_of_the_start_arrive() -> None:
    with pytest.raises(ValueError, match="negative"):
        list(in_order(1, math.factorial, [1, -1], *NOTHING))
    with pytest.raises(ZeroDivisionError):
        list(in_order(1, math.factorial, [1], operator.truediv, (1, 0), "a worker died"))


def test_an_item_whose_workers_die_is_set_aside_and_the_others_are_done() -> None:
    first, second = in_order(2, os._exit, [1, 2], *NOTHING)
    assert [first.item, second.item] == [1, 2]
    assert str(first) == "its process died twice (exit status 1)"
    killed, done = in_order(1, signal.raise_signal, [signal.SIGKILL, signal.SIGCONT], *NOTHING)
    assert str(killed) == "its process was killed twice (SIGKILL), perhaps for lack of memory"
    assert done is None, "the run goes on after it"


def test_workers_that_die_as_they_start_are_one_sentence() -> None:
    with pytest.raises(DataError, match=r"^a worker died$"):
        list(in_order(2, math.factorial, [1, 1], os._exit, (1,), "a worker died"))


SCRIPT = """
import multiprocessing, operator, signal, sys, time
from roundel.datasets.worker_pool import in_order

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for commands in the background

    def items():
        yield 0
        yield 0
        print(*(p.pid for p in multiprocessing.active_children()), flush=True)
        yield 60
    try:
        list(in_order(2, time.sleep, items(), operator.not_, (0,), "died"))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_workers_end_with_their_parent(tmp_path, number: int, status: int) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    # A session of its own, so that the whole group is signalled as by Ctrl-C in a terminal.
    command = [sys.executable, str(tmp_path / "script.py")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        workers = [int(word) for word in process.stdout.readline().split()]
        assert len(workers) == 2
        time.sleep(0.5)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)
        else:
            process.kill()
        _, errors = process.communicate(timeout=30)
        assert process.returncode == status
        # After SIGKILL Python's own tracker speaks of semaphores.
        assert errors == "" or number == signal.SIGKILL
        limit = time.monotonic() + 20
        while any(map(running, workers)) and time.monotonic() < limit:
            time.sleep(0.05)
        assert not any(map(running, workers))


def running(pid: int) -> bool:
    """Whether a process runs; one that has ended but was not waited for does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
