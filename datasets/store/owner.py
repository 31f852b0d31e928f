"""Who writes: the identity of a process, and whether it still runs.

Temporary files and logs carry the name of their process, and are removed only when it is gone. A process holds a lock
on its log as long as it runs: the system gives it back when the process ends, however it ends, on every host of a
shared disk. Without a log, a process of this host is looked up by its number and its time of start.
"""

from __future__ import annotations

import hashlib
import os
import re
import socket
from functools import cache
from pathlib import Path

_OWNER = re.compile(r"[0-9a-f]{8}-[0-9]{1,10}-[0-9]{1,20}")


@cache
def _machine() -> str:
    """Eight digits for this host since it was started, and for its container: process numbers mean something there."""
    about = [socket.gethostname()]
    try:
        about.append(Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii"))
        about.append(os.readlink("/proc/self/ns/pid"))
    except OSError:
        pass  # not Linux
    return hashlib.sha256("\n".join(about).encode()).hexdigest()[:8]


def _started(pid: int) -> int | None:
    """When a process of this host was started, in clock ticks since the host was; None if there is no such process.

    0 where the system does not tell.
    """
    if not os.path.exists("/proc/self/stat"):
        if os.name != "posix":
            return 0  # signal 0 would end the process on Windows
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return None
        except OSError:
            pass
        return 0
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The name of the command stands in brackets and may hold anything.
    fields = text.rpartition(")")[2].split()
    return None if fields[0] in ("Z", "X") else int(fields[19])


def own_name() -> str:
    """The name of this process: host, number, time of start. It reveals no name of a host or user."""
    return f"{_machine()}-{os.getpid()}-{_started(os.getpid()) or 0}"


def is_name(text: str) -> bool:
    """Whether a text may be the name of a process."""
    return _OWNER.fullmatch(text) is not None


def is_here(owner: str) -> bool:
    """Whether a process runs, or ran, on this host."""
    return is_name(owner) and owner.startswith(_machine())


def is_gone(owner: str) -> bool:
    """Whether a process certainly runs no more; False of another host's, of which nothing is known."""
    if not is_name(owner):
        return True  # of no version of Roundel that has owners
    machine, pid, started = owner.split("-")
    if machine != _machine():
        return False
    return _started(int(pid)) != int(started)
