"""Half requests, slow ones and too many of them keep nobody out and leave no line of an error."""

import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import uvicorn

from tests.live.sources.servers import wait_for
from windsysid.live.page import connections
from windsysid.live.page.app import app
from windsysid.live.page.connections import Connections, bounded, connection_limit

HALF = b"GET /health HTTP/1.1\r\nHost: localhost\r\nX-a: "
POST = b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\ntoken="
WHOLE = b"GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture
def serve(store) -> Iterator[Callable[[Connections], int]]:
    """A page on a port of this machine."""
    servers: list[tuple[uvicorn.Server, threading.Thread]] = []

    def start(open_: Connections) -> int:
        config = uvicorn.Config(app(store), port=0, log_config=None, lifespan="off", ws="none", http=bounded(open_))
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, daemon=True)
        servers.append((server, thread))
        thread.start()
        wait_for(lambda: server.started)
        return int(server.servers[0].sockets[0].getsockname()[1])

    yield start
    for server, thread in servers:
        server.should_exit = True
        thread.join(10.0)


def opened(port: int, said: bytes) -> socket.socket:
    one = socket.create_connection(("127.0.0.1", port), 10.0)
    one.settimeout(10.0)
    one.sendall(said)
    return one


def answer(port: int) -> bytes:
    with opened(port, WHOLE) as one:
        return one.recv(4000)[:15]


def received(one: socket.socket) -> bytes:
    """A whole answer of /health, whose head and body may come apart."""
    said = b""
    while not said.endswith(b"}"):
        said += one.recv(4000)
    return said


def ended(one: socket.socket) -> bool:
    """Whether the other side has closed a connection."""
    one.settimeout(0.01)
    try:
        return one.recv(1) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


@pytest.mark.parametrize("said", [HALF, POST, b""])
def test_half_requests_keep_nobody_out_not_even_those_of_their_own_address(serve, said):
    open_ = Connections(20, 10)
    port = serve(open_)
    half = [opened(port, said) for _ in range(15)]
    wait_for(lambda: len(open_) == 10)
    assert [answer(port) for _ in range(3)] == [b"HTTP/1.1 200 OK"] * 3
    assert len(open_) <= 10
    wait_for(lambda: sum(ended(one) for one in half) >= 5)
    for one in half:
        one.close()
    wait_for(lambda: len(open_) == 0)


@pytest.mark.parametrize("said", [HALF, POST, b"", WHOLE + HALF])
def test_a_request_that_does_not_come_to_its_end_is_closed(serve, monkeypatch, said):
    monkeypatch.setattr(connections, "MAX_REQUEST_SECONDS", 0.2)
    port = serve(Connections())
    with opened(port, said) as one:
        begun = time.monotonic()
        try:
            while one.recv(4000):
                pass
        except ConnectionResetError:
            pass
        assert 0.1 < time.monotonic() - begun < 5.0


def test_a_connection_that_is_kept_alive_between_two_requests_is_left_open(serve, monkeypatch):
    monkeypatch.setattr(connections, "MAX_REQUEST_SECONDS", 0.2)
    with opened(serve(Connections()), WHOLE) as one:
        assert received(one).startswith(b"HTTP/1.1 200 OK")
        time.sleep(0.5)
        one.sendall(WHOLE)
        assert received(one).startswith(b"HTTP/1.1 200 OK")


def test_a_client_that_does_not_read_its_answer_is_closed(serve, monkeypatch):
    monkeypatch.setattr(connections, "MAX_READ_SECONDS", 0.2)
    open_ = Connections()
    asks = b"GET /static/uplot.js HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.connect(("127.0.0.1", serve(open_)))
        one.settimeout(0.2)
        try:
            for _ in range(2000):
                one.sendall(asks)
        except OSError:
            pass
        wait_for(lambda: len(open_) == 0)


def test_a_request_that_is_broken_off_is_no_error(serve, caplog):
    port = serve(Connections())
    caplog.set_level(logging.WARNING)
    for path in (b"/login", b"/api/alarms/T01/acknowledge"):
        for body in (b"", b'{"by": "m'):
            head = (
                b"POST %b HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n"
            )
            opened(port, head % path + body).close()
    assert answer(port) == b"HTTP/1.1 200 OK"
    time.sleep(0.2)
    assert [record.getMessage() for record in caplog.records] == []


class Connection:
    """One that waits or not."""

    def __init__(self, waits: bool) -> None:
        self.waits, self.transport = waits, self
        self.aborted = False

    def abort(self) -> None:
        self.aborted = True


def test_where_all_are_being_answered_a_new_one_has_to_wait():
    open_ = Connections(3, 2)
    busy = [Connection(False) for _ in range(3)]
    assert [open_.enter(one, address) for one, address in zip(busy, "aab", strict=True)] == [True] * 3
    assert not open_.enter(Connection(True), "a")
    assert not open_.enter(Connection(True), "c")
    busy[2].waits = True
    assert open_.enter(Connection(True), "c")
    assert [one.aborted for one in busy] == [False, False, True]
    for one in busy:
        open_.leave(one)
    assert len(open_) == 1


def test_there_are_files_for_all_connections():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (512, before[1]))
        assert connection_limit() <= resource.getrlimit(resource.RLIMIT_NOFILE)[0] - 256
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
