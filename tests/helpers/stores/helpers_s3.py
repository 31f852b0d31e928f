"""A server of S3 on this machine (moto), and a proxy before it that fails one request in so many."""

from __future__ import annotations

import contextlib
import http.client
import random
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

BUCKET = "bucket"


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextlib.contextmanager
def s3_server() -> Iterator[str]:
    """A server with an empty bucket; yields its address."""
    port = free_port()
    program = "import sys; from moto.server import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    address = f"http://127.0.0.1:{port}"
    try:
        _wait_for(address, server)
        urllib.request.urlopen(urllib.request.Request(f"{address}/{BUCKET}", method="PUT"), timeout=10).close()
        yield address
    finally:
        server.kill()
        server.wait()


def _wait_for(address: str, server: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + 60
    while True:
        try:
            urllib.request.urlopen(f"{address}/moto-api/", timeout=1).close()
        except OSError:
            assert server.poll() is None, "the server ended"
            assert time.monotonic() < until, "the server does not answer"
            time.sleep(0.1)
        else:
            return


def use_s3(patch: pytest.MonkeyPatch, address: str) -> None:
    """Let this process and those that it starts use a server."""
    from roundel.datasets.store import bucket

    for name, value in settings(address).items():
        patch.setenv(name, value)
    bucket.client_of.cache_clear()


def settings(address: str) -> dict[str, str]:
    """The environment of a process that uses a server."""
    about = {"ACCESS_KEY_ID": "test", "SECRET_ACCESS_KEY": "test", "REGION": "us-east-1"}
    return {f"AWS_{name}": value for name, value in {"ENDPOINT_URL": address, **about}.items()}


@dataclass
class Faults:
    """What a proxy does to one request in `every`: drop it, delay it, cut the answer or the request short.

    A `lie` is an answer that is cut short and has the length of what is left.
    """

    every: int
    seed: int = 0
    kinds: tuple[str, ...] = ("drop", "delay", "cut answer", "cut request", "drop answer", "refuse")
    counts: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._draw, self._lock = random.Random(self.seed), threading.Lock()

    def next(self) -> str:
        """The kind of the next request's fault; empty for none."""
        with self._lock:
            kind = self._draw.choice(self.kinds) if self._draw.randrange(self.every) == 0 else ""
            self.counts[kind] = self.counts.get(kind, 0) + 1
            return kind


@contextlib.contextmanager
def faulty_proxy(target: str, faults: Faults) -> Iterator[str]:
    """A server that passes requests on to `target`, but for the faults; yields its address."""
    host = target.removeprefix("http://")

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def _pass(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            kind = faults.next()
            self.close_connection = bool(kind) and kind != "delay"
            if kind == "drop":
                return
            if kind == "delay":
                time.sleep(0.3)
            if kind == "refuse":
                self.send_error(503, "Slow Down")
                return
            with contextlib.closing(http.client.HTTPConnection(host, timeout=30)) as there:
                there.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
                for name, value in self.headers.items():
                    there.putheader(name, value)
                there.endheaders()
                if kind == "cut request":
                    # The server sees a body that ends before its length.
                    there.send(body[: len(body) // 2])
                    there.sock.shutdown(socket.SHUT_WR)
                    with contextlib.suppress(OSError, http.client.HTTPException):
                        there.getresponse().read()
                    return
                there.send(body)
                answer = there.getresponse()
                data = answer.read()
            if kind == "drop answer":
                return
            if kind == "lie" and self.command == "GET":
                data = data[: len(data) // 2]
            length = answer.headers["Content-Length"] if self.command == "HEAD" else str(len(data))
            self.send_response(answer.status)
            for name, value in answer.getheaders():
                if name.lower() not in ("transfer-encoding", "connection", "date", "server", "content-length"):
                    self.send_header(name, value)
            self.send_header("Content-Length", length or "0")
            self.end_headers()
            self.wfile.write(data[: len(data) // 2] if kind == "cut answer" else data)

        do_GET = do_PUT = do_HEAD = do_POST = do_DELETE = _pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    server.handle_error = lambda *_: None  # type: ignore[method-assign]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
