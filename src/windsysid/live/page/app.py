"""The page of the live service and its API.

All data are read from the store at each request. Acknowledgements are the only data that are written.
"""

import time
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, cast

from fastapi import APIRouter, Depends, FastAPI, Header, HTTPException, Path, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent
from fastapi.staticfiles import StaticFiles

from windsysid import reports
from windsysid._version import __version__
from windsysid.errors import WindsysidError
from windsysid.live.engine_state import PageEngine
from windsysid.live.page import models
from windsysid.live.page.access import Access, Role
from windsysid.live.page.door import Door
from windsysid.live.page.guard import RequestGuard, RequestLimits
from windsysid.live.page.metrics import MEDIA_TYPE, metrics_text
from windsysid.live.page.newest import Newest
from windsysid.live.page.results import NS_PER_MS, detail_of, levels_of, results_of
from windsysid.live.page.spectra import spectra_of, waterfall_of
from windsysid.live.page.streams import Streams, TooManyStreams
from windsysid.live.page.views import alarm_seen, overview_of, sources_of, trouble_of, turbine_of
from windsysid.live.sources.source import BlockSource
from windsysid.live.store.store import Store

__all__ = ["app", "streams_of"]

STATIC = FilePath(__file__).parent / "static"
PLOTS = FilePath(reports.__file__).parent / "static"
"""Script and style of the plots of report pages."""

MAX_POINTS = 4000
"""Setting: largest number of windows in one answer."""

MAX_SPECTRA = 800
"""Setting: spectra of one waterfall."""

MAX_TIME_MS = 9.2e12
"""Largest time [ms] whose nanoseconds have 64 bits: the year 2261."""

MAX_EVENT = 2**63 - 1

Name = Annotated[str, Path(pattern=r"^[\w. -]*\w$", max_length=200, description="of a turbine")]
Moment = Annotated[float | None, Query(ge=0.0, le=MAX_TIME_MS, allow_inf_nan=False, description="ms since 1970, UTC")]
Most = Annotated[int, Query(ge=2, le=MAX_POINTS, description="of more windows, a sample at equal steps")]
Key = Annotated[str, Path(max_length=500, pattern=r"^[^\x00-\x1f\x7f]+$", description="of an alarm")]


Responses = dict[int | str, dict[str, Any]]


def _errors(**of: str) -> Responses:
    """HTTP statuses and their descriptions."""
    return {int(status[1:]): {"model": models.RequestProblem, "description": text} for status, text in of.items()}


def _beside_text(errors: Responses) -> Responses:
    """Error responses of a path that answers text: errors are JSON there, too."""
    said = {"application/json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": error["description"], "content": said} for status, error in errors.items()}


ERRORS = _errors(
    _400="the body is no text",
    _401="a token is required",
    _403="not allowed with this token or from this origin",
    _413="the body is too large",
    _414="the address is too long",
    _429="too many requests, or too many wrong tokens",
    _503="the store does not answer",
)
UNKNOWN = _errors(_404="nothing has this name")


def app(
    store: Store, engine: PageEngine | None = None, access: Access = Access(), *,
    limits: RequestLimits = RequestLimits(),
    sources: Sequence[BlockSource] = (), note: str = "",
) -> FastAPI:  # fmt: skip
    """The page over a store.

    Parameters
    ----------
    engine
        Engine whose state is shown and that takes acknowledgements. None: a page over a store without a running
        engine; acknowledgements go to the store.
    access
        Tokens. Without tokens everyone who reaches the page has access, and it answers to names of this machine only.
        `Access.check` checks the address of the server.
    limits
        Of sizes and rates.
    sources
        Sources whose state is shown.
    note
        A sentence above the list of turbines.

    Returns
    -------
    fastapi.FastAPI
        Call ``streams_of(app).close()`` before its server is stopped: a server waits for open answers.
    """
    page = FastAPI(
        title="windsysid live", version=__version__, docs_url=None, redoc_url=None, openapi_url="/api/openapi.json",
        description="Estimates, alarms and health of turbines. Times are ms since 1970, UTC.",
    )  # fmt: skip
    page.state.streams = streams = Streams(store, limits.streams)
    door = Door(access, limits)
    overview = _Overviews(store, engine, door, sources, note)
    page.include_router(_service(store, overview, door, sources), responses=ERRORS)
    page.include_router(_turbines(store, engine, overview.newest, door), responses=ERRORS)
    page.include_router(_alarms(store, engine, door), responses=ERRORS)
    page.include_router(_events(streams, door), responses=_beside_text(ERRORS))
    page.include_router(_metrics(store, overview, streams, door), responses=_beside_text(ERRORS))
    page.include_router(door.routes())
    page.add_exception_handler(WindsysidError, _store_is_away)
    page.add_exception_handler(RequestValidationError, _invalid)
    page.add_middleware(RequestGuard, access=access, limits=limits)
    page.mount("/static", StaticFiles(directory=STATIC), name="static")
    page.mount("/plots", StaticFiles(directory=PLOTS), name="plots")
    return page


def streams_of(page: FastAPI) -> Streams:
    """The event streams of a page."""
    return cast(Streams, page.state.streams)


class _Overviews:
    """Overviews of one store."""

    def __init__(
        self, store: Store, engine: PageEngine | None, door: Door, sources: Sequence[BlockSource], note: str
    ) -> None:
        self.newest = Newest(store)
        self._store, self._engine, self._door, self._sources, self._note = store, engine, door, sources, note

    def __call__(self, role: Role) -> models.PageOverview:
        found = overview_of(self._store, self._engine, self.newest, role, self._door.asks)
        known = {"note": self._note, "sources": sources_of(self._sources), "store": self._store.trouble}
        return found.model_copy(update=known)


def _service(store: Store, overview: _Overviews, door: Door, sources: Sequence[BlockSource]) -> APIRouter:
    """The page itself, the overview and health."""
    router = APIRouter()

    @router.get("/", include_in_schema=False)
    def index() -> FileResponse:
        return FileResponse(STATIC / "index.html")

    @router.get("/api/overview")
    def read_overview(role: Annotated[Role, Depends(door)]) -> models.PageOverview:
        """All turbines, worst first."""
        return overview(role)

    @router.get("/health", responses={503: {"model": models.Health, "description": "the store accepts no blocks"}})
    def health(response: Response) -> models.Health:
        """State of the store and the sources; needs no token."""
        states = Counter(source.state.state for source in sources)
        status: Literal["ok", "degraded", "failed"] = "degraded" if states["failed"] or states["trying"] else "ok"
        if trouble_of(store):
            response.status_code, status = 503, "failed"
            response.headers["Retry-After"] = "5"
        return models.Health(status=status, version=__version__, sources=states)

    return router


def _metrics(store: Store, overview: _Overviews, streams: Streams, door: Door) -> APIRouter:
    """Route of the metrics."""
    router = APIRouter()

    @router.get("/metrics", response_class=PlainTextResponse, dependencies=[Depends(door)])
    def metrics() -> Response:
        """For Prometheus."""
        known = overview("reader")
        results = overview.newest.of([one.name for one in known.turbines])
        return Response(metrics_text(known, results, store.size(), streams.count), media_type=MEDIA_TYPE)

    return router


def _turbines(store: Store, engine: PageEngine | None, newest: Newest, door: Door) -> APIRouter:
    """One turbine, now and over time."""
    router = APIRouter(prefix="/api/turbines/{turbine}", dependencies=[Depends(door)], responses=UNKNOWN)

    def known(turbine: Name) -> str:
        if turbine not in store.turbines() and (engine is None or turbine not in engine.state().turbines):
            raise HTTPException(404, "there is no turbine of this name")
        return turbine

    @router.get("")
    def turbine(turbine: Name) -> models.TurbinePage:
        """Current state of a turbine."""
        try:
            return turbine_of(store, engine, newest, turbine)
        except KeyError:
            raise HTTPException(404, "there is no turbine of this name") from None

    @router.get("/levels")
    def levels(
        turbine: Annotated[str, Depends(known)], since: Moment = None, until: Moment = None, most: Most = 2000
    ) -> models.Levels:
        """Levels of the watched series over time."""
        return levels_of(store.levels(turbine, since=_ns(since), until=_ns(until), most=most))

    @router.get("/results")
    def results(
        turbine: Annotated[str, Depends(known)], since: Moment = None, until: Moment = None, most: Most = 2000
    ) -> models.Results:
        """Modes, loads, rotor speed and trust over time."""
        return results_of(store.results(turbine, since=_ns(since), until=_ns(until), most=most))

    @router.get("/spectrum")
    def spectrum(turbine: Annotated[str, Depends(known)], until: Moment = None) -> models.Spectra:
        """Spectra with the model of the newest window, or of the last one that starts before `until`."""
        return spectra_of(store.spectra(turbine, until=_ns(until), most=1))

    @router.get("/waterfall")
    def waterfall(
        turbine: Annotated[str, Depends(known)],
        channel: Annotated[str | None, Query(max_length=200, description="as in `channels`; the first")] = None,
        since: Moment = None,
        until: Moment = None,
        most: Annotated[int, Query(ge=1, le=MAX_SPECTRA, description="of more windows, a sample at equal steps")] = 336,
    ) -> models.Waterfall:
        """Measured spectrum of a channel over time."""
        return waterfall_of(store.spectra(turbine, since=_ns(since), until=_ns(until), most=most), channel)

    @router.get("/results/{window}")
    def result(
        turbine: Annotated[str, Depends(known)],
        window: Annotated[float, Path(ge=0.0, le=MAX_TIME_MS, allow_inf_nan=False, description="its begin, ms")],
    ) -> models.Detail:
        """All results of one window."""
        begin = round(window * NS_PER_MS)
        found = store.results(turbine, since=begin, until=begin + NS_PER_MS, newest=1)
        if not found:
            raise HTTPException(404, "there is no result of a window that begins then")
        return detail_of(found[0])

    return router


def _alarms(store: Store, engine: PageEngine | None, door: Door) -> APIRouter:
    """Alarms, and their acknowledgement."""
    router = APIRouter(prefix="/api/alarms")

    @router.get("", dependencies=[Depends(door)])
    def alarms(
        turbine: Annotated[str | None, Query(pattern=r"^[\w. -]*\w$", max_length=200)] = None,
        open_only: bool = False,
        most: Annotated[int, Query(ge=1, le=MAX_POINTS)] = 200,
    ) -> list[models.AlarmSeen]:
        """Alarms, newest first."""
        return [alarm_seen(alarm) for alarm in store.alarms(turbine=turbine, open_only=open_only, most=most)]

    @router.post("/{key:path}/acknowledge", dependencies=[Depends(door.operator)], responses=UNKNOWN)
    def acknowledge(key: Key, said: models.Acknowledgement) -> models.AlarmSeen:
        """Acknowledge an alarm; operators only. A repetition changes nothing."""
        try:
            at = time.time_ns()
            if engine is None:
                return alarm_seen(store.acknowledge(key, by=said.by, remark=said.remark, at=at))
            return alarm_seen(engine.acknowledge(key, said.by, said.remark))
        except KeyError:
            raise HTTPException(404, "there is no alarm of this key") from None

    return router


def _events(streams: Streams, door: Door) -> APIRouter:
    """Route of the event stream."""
    router = APIRouter()

    async def counted_in() -> AsyncIterator[None]:
        try:
            streams.enter()
        except TooManyStreams:
            raise HTTPException(503, "too many event streams are open", {"Retry-After": "10"}) from None
        try:
            yield
        finally:
            streams.leave()

    @router.get("/api/events", response_class=EventSourceResponse, dependencies=[Depends(door), Depends(counted_in)])
    async def events(
        after: Annotated[int | None, Query(ge=0, le=MAX_EVENT, description="an event: what came after it")] = None,
        last_event_id: Annotated[str | None, Header(description="as `after`; it goes before it")] = None,
    ) -> AsyncIterator[ServerSentEvent]:
        """Changes as server-sent events; ids are those of the store's journal."""
        begin = int(last_event_id) if last_event_id and _is_event(last_event_id) else after
        yield ServerSentEvent(comment="windsysid live", retry=2000)
        async for told, changes in streams.follow(begin):
            yield ServerSentEvent(data=changes, event="changes", id=str(told))

    return router


def _is_event(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < 19


def _ns(ms: float | None) -> int | None:
    return None if ms is None else round(ms * NS_PER_MS)


def _store_is_away(request: Request, error: Exception) -> JSONResponse:
    return JSONResponse({"detail": "the store does not answer: see the service's log"}, 503, {"Retry-After": "5"})


def _invalid(request: Request, error: Exception) -> JSONResponse:
    """Errors of a request, without its content: an answer never repeats input of a client."""
    found = cast(RequestValidationError, error).errors()
    detail = [{"type": one["type"], "loc": list(one["loc"]), "msg": one["msg"]} for one in found]
    return JSONResponse({"detail": detail}, 422)
