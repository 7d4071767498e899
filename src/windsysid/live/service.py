"""The service: store, engine, sources, notices and the page in one process, started and ended in order.

A signal ends it: sources stop, what is under way is written down, event streams close, the store closes; all within
`END_SECONDS`, after which it ends whatever is left. That loses nothing: what was acknowledged is in the store, and
what was not will be sent again. A second signal ends it at once.
"""

import asyncio
import contextlib
import functools
import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.live.configuration.settings import PageSettings, Settings
from windsysid.live.engine import Delays, Engine, Followed
from windsysid.live.logs import event
from windsysid.live.notify import LogRecipient, Recipient, recipient_of, tell_alarms
from windsysid.live.sources.source import BlockSource
from windsysid.live.store.keep import Keep
from windsysid.live.store.opening import open_store
from windsysid.live.store.store import Store
from windsysid.live.watch.watching import WatchOptions

__all__ = ["END_SECONDS", "listen", "serve", "url_of"]

END_SECONDS = 5.0
"""From a signal to the end, at most."""

MAX_DRAIN_SECONDS = 3.0
"""Part of it for the engine to finish open windows."""

MAX_STREAM_SECONDS = 1
"""Part of it for open answers [s, whole]."""

RETRY_SECONDS = 60.0
"""After which a source that failed is started again."""

THIN_SECONDS = 6 * 3600.0
"""Interval of thinning the store [s]."""

MAX_TRIED_PORTS = 20

BACKLOG = 128
"""Length of the queue of connections that are not accepted yet."""


def listen(page: PageSettings, *, any_near: bool = False) -> socket.socket:
    """Take the page's port before anything is started.

    Parameters
    ----------
    any_near
        Take the next one that is free, where it is taken.

    Raises
    ------
    ConfigurationError
        If it cannot be had.
    """
    last = min(page.port + MAX_TRIED_PORTS, 65536) if any_near else page.port + 1
    for port in range(page.port, last):
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(page.host, port, type=socket.SOCK_STREAM)[0]
            taken = socket.socket(family, kind, protocol)
            try:
                if os.name == "posix":
                    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                taken.bind(address)
                taken.listen()  # two may bind one port: only one may listen
                return taken
            except OSError:
                taken.close()
                raise
        except OSError as error:
            if port + 1 == last:
                raise ConfigurationError(
                    f"page: {page.host}:{port} is not available ({error.strerror}): choose another host or port"
                ) from None
    raise AssertionError


def url_of(page: PageSettings, listening: socket.socket) -> str:
    """The page's address, as a browser of this machine takes it."""
    host = {"0.0.0.0": "localhost", "::": "localhost"}.get(page.host, page.host)
    shown = f"[{host}]" if ":" in host else host
    return f"{'http' if page.certificate is None else 'https'}://{shown}:{listening.getsockname()[1]}/"


def serve(
    settings: Settings,
    sources: Sequence[BlockSource],
    listening: socket.socket,
    *,
    now: Callable[[], int] = time.time_ns,
    ready: Callable[[str], None] = lambda url: None,
    note: str = "",
) -> int:
    """Run until a signal ends it; the exit code.

    Parameters
    ----------
    listening
        Where the page is, by `listen`.
    now
        The clock that blocks are held against [ns since 1970].
    ready
        Called with the page's address when it answers.
    note
        A sentence that stands above the page's turbines.

    Raises
    ------
    WindsysidError
        If it cannot start: store, turbines, tokens.
    """
    with contextlib.ExitStack() as stack:
        stack.callback(listening.close)
        _access_of(settings.page)  # report wrong tokens before a store is created
        store = open_store(settings.store, Keep(**settings.keep))
        stack.callback(store.close)
        options = WatchOptions(settings.window, settings.learn, settings.alarms_per_year)
        followed = [Followed(member, settings.window, settings.formulation, options) for member in settings.turbines]
        delays = Delays(settings.lateness, settings.silence)
        engine = Engine(followed, store, workers=settings.workers, delays=delays, now=now, on_event=_log_event)
        return asyncio.run(_run(settings, sources, listening, store, engine, ready, note))


def _access_of(page: PageSettings) -> Any:
    from windsysid.live.page.access import Access

    access = Access(page.reader.value if page.reader else None, page.operator.value if page.operator else None)
    access.check(page.host)
    return access


async def _run(
    settings: Settings,
    sources: Sequence[BlockSource],
    listening: socket.socket,
    store: Store,
    engine: Engine,
    ready: Callable[[str], None],
    note: str,
) -> int:
    stop, end = asyncio.Event(), _End()
    for number in (signal.SIGTERM, signal.SIGINT):
        _on_signal(number, functools.partial(end.by, number, stop))
    server, streams = _server(settings, store, engine, sources, note)
    web = asyncio.create_task(server.serve(sockets=[listening]), name="page")
    others = [asyncio.create_task(_supply(source, engine, stop)) for source in sources]
    told: list[Recipient] = [LogRecipient(), *map(recipient_of, settings.notices)]
    others += [asyncio.create_task(tell_alarms(store, recipient, stop)) for recipient in told]
    others.append(asyncio.create_task(_thin(store, stop)))
    while not server.started and not web.done():
        await asyncio.sleep(0.02)
    event(logging.INFO, "follows", turbines=len(settings.turbines), sources=len(sources), store=_shown(settings.store))
    _tell_systemd("READY=1")
    ready(url_of(settings.page, listening))
    stopped = asyncio.create_task(stop.wait())
    await asyncio.wait([stopped, web], return_when=asyncio.FIRST_COMPLETED)
    if web.done():  # it ended unexpectedly
        event(logging.ERROR, "the page ended by itself: the service ends too", why=repr(web.exception()))
        end.by(0, stop)
    _tell_systemd("STOPPING=1")
    streams.close()
    server.should_exit = True
    drained = asyncio.create_task(asyncio.to_thread(engine.drain, MAX_DRAIN_SECONDS))
    await asyncio.wait([drained, web, *others], timeout=END_SECONDS - 1.0)
    for task in others:
        task.cancel()
    unfinished = sum(one.windows for one in engine.state().turbines.values())
    event(logging.INFO, "ended: all accepted blocks are in the store", windows_waiting=unfinished)
    end.done(store)
    return end.code


class _End:
    """Handler of signals: an orderly end, which a second signal or the clock shortens."""

    def __init__(self) -> None:
        self.code = 0
        self._clock: threading.Timer | None = None

    def by(self, number: int, stop: asyncio.Event) -> None:
        """End; a second time, end at once."""
        if stop.is_set():
            os._exit(128 + number)
        self.code = 0 if number == signal.SIGTERM else 130 if number == signal.SIGINT else 1
        event(logging.INFO, "ends", why=signal.Signals(number).name if number else "the page ended")
        self._clock = threading.Timer(END_SECONDS, self._cut)
        self._clock.daemon = True
        self._clock.start()
        stop.set()

    def _cut(self) -> None:
        event(logging.WARNING, f"not finished within {END_SECONDS:g} s: ended; the next start continues from the store")
        os._exit(self.code)

    def done(self, store: Store) -> None:
        """The store closes within the same time; then the clock stops."""
        store.close()
        if self._clock is not None:
            self._clock.cancel()


def _on_signal(number: signal.Signals, act: Callable[[], None]) -> None:
    loop = asyncio.get_running_loop()
    try:
        loop.add_signal_handler(number, act)
    except (NotImplementedError, RuntimeError):  # Windows, or not the main thread
        with contextlib.suppress(ValueError):
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(act))


def _server(
    settings: Settings, store: Store, engine: Engine, sources: Sequence[BlockSource], note: str
) -> tuple[Any, Any]:
    import uvicorn

    from windsysid.live.page.app import app, streams_of
    from windsysid.live.page.connections import Connections, bounded, connection_limit

    class Server(uvicorn.Server):
        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield  # signals are ours

    page = app(store, engine, _access_of(settings.page), sources=sources, note=note)
    certificate, key = settings.page.certificate, settings.page.key
    config = uvicorn.Config(
        page, log_config=None, access_log=False, server_header=False, lifespan="off", ws="none",
        http=bounded(Connections(connection_limit())), backlog=BACKLOG, timeout_keep_alive=30,
        timeout_graceful_shutdown=MAX_STREAM_SECONDS,
        ssl_certfile=certificate, ssl_keyfile=key,
    )  # fmt: skip
    return Server(config), streams_of(page)


async def _supply(source: BlockSource, engine: Engine, stop: asyncio.Event) -> None:
    """Run a source; one that fails is started again, and the others go on meanwhile."""
    while not stop.is_set():
        event(logging.INFO, "source", source=source.describe())
        try:
            await source.run(engine.push, stop)
            if not stop.is_set():
                event(logging.INFO, "source ended", source=source.describe(), blocks=source.state.blocks)
            return
        except Exception as error:
            if stop.is_set():
                return
            known = isinstance(error, WindsysidError | OSError)
            source.state = source.state._replace(state="failed", text=" ".join(str(error).split()) or repr(error))
            event_text = f"source failed: {error}; tried again in {RETRY_SECONDS:g} s"
            logging.getLogger("windsysid").error("%s: %s", source.describe(), event_text, exc_info=not known)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), RETRY_SECONDS)


async def _thin(store: Store, stop: asyncio.Event) -> None:
    while not stop.is_set():
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), THIN_SECONDS)
            return
        try:
            await asyncio.to_thread(store.thin, now=time.time_ns())
        except WindsysidError as error:
            event(logging.WARNING, f"old rows were not removed from the store: {error}")


def _log_event(name: str, **fields: Any) -> None:
    """Event of the engine as a line of the log."""
    failed = "failed" in name or fields.get("status") == "failed"
    event(logging.ERROR if failed else logging.DEBUG, name, **fields)  # alarms are sent from the store's journal


def _shown(store: str) -> str:
    return store if "://" not in store else store.partition("?")[0]


def _tell_systemd(text: str) -> None:
    """Tell systemd how far we are, where it asks (Type=notify)."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as told:
        told.connect(f"\0{address[1:]}" if address.startswith("@") else address)
        told.sendall(text.encode())
