"""The server: a port of this machine, and the answers to requests that the guard lets through."""

import asyncio
import contextlib
import io
import re
import socket
import zipfile
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import uvicorn
from fastapi import Body, FastAPI, Path as InPath, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from starlette.exceptions import HTTPException
from uvicorn.protocols.http.h11_impl import H11Protocol

from pipeline.errors import PipelineError, RequestError, StageError
from pipeline.findings.text import environment
from pipeline.formats import appearance
from pipeline.scenario import catalogue
from pipeline.serve.guard import FILES, Guard, Keys, refused
from pipeline.serve.plans import (
    ASKED,
    MAX_FILE_BYTES,
    AskedPlan,
    GivenFiles,
    NotTakenError,
    PlanRequest,
    Plans,
    too_large,
)
from pipeline.voyage.positions import read_position

HOST = "127.0.0.1"
"""The only address that the server listens at; other machines can't reach it."""
USUAL_PORT = 8137
"""The default port, if it is free."""
# Folder, inside the output folder, of the files that the page is given.
_GIVEN = ".given"
# Connections at a time: a browser opens six. Before one more is opened, the oldest connection
# without a request is closed.
_MAX_CONNECTIONS = 200
# Seconds in which the head of a request must come.
_HEAD_S = 10.0
# Seconds that answers in progress may still take when the server stops.
_GRACE_S = 2
_Identity = Annotated[str, InPath(pattern=r"^[0-9a-f]{32}$")]
_TYPES = {"js": "text/javascript", "css": "text/css", "html": "text/html"}
# Seconds that a browser may keep a tile of the land.
_TILE_S = 86_400
_HERE = Path(__file__).parent
# A name that a script of the report defines at its top level.
_DEFINED = re.compile(r"^(?:async )?(?:function|class|const) (\w+)", re.MULTILINE)
_Title = Annotated[str, Body(max_length=100)]

REPORT_POLICY = (
    f"sandbox allow-scripts allow-popups; default-src 'none'; "
    f"script-src '{appearance.content_hash(appearance.script())}'; style-src 'unsafe-inline'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The policy of a report: it may run its own script alone, in an origin of its own."""


def serve(plans: Plans, port: int | None, on_ready: Callable[[str], None]) -> None:
    """Serve the page until the process is stopped; call `on_ready` with the first address.

    `port` is 0 for any that is free, and None for the usual one if that is free. Raises
    RequestError if the port is taken.
    """
    with _listening(port) as opened:
        keys = Keys(opened.getsockname()[1])
        config = uvicorn.Config(
            make_app(keys, plans, GivenFiles(plans.output / _GIVEN)),
            log_level="warning",
            access_log=False,
            server_header=False,
            http=_Connection,
            limit_concurrency=_MAX_CONNECTIONS + 1,
            timeout_graceful_shutdown=_GRACE_S,
        )
        on_ready(keys.address)  # the port is open already, and requests wait for the server
        uvicorn.Server(config).run(sockets=[opened])


class _Connection(H11Protocol):
    """A connection that is closed if no request comes in time, or when others need its place."""

    _open: ClassVar[dict["_Connection", None]] = {}  # the oldest first

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room, and wait for a request."""
        super().connection_made(transport)
        if len(self._open) >= _MAX_CONNECTIONS:
            next(filter(_Connection.is_idle, self._open), self).end_if_idle()
        self._open[self] = None
        self._head = self.loop.call_later(_HEAD_S, self.end_if_idle)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._open.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take a part of a request; the time limit for the head of the next request starts anew."""
        super().data_received(data)
        if not self.is_idle() or self._head.when() < self.loop.time():
            self._head.cancel()
            self._head = self.loop.call_later(_HEAD_S, self.end_if_idle)

    def is_idle(self) -> bool:
        """Whether every request has been answered."""
        return self.cycle is None or self.cycle.response_complete  # type: ignore[redundant-expr]

    def end_if_idle(self) -> None:
        """Close the connection, unless a request is at work."""
        if self.is_idle():
            self._open.pop(self, None)
            self.transport.abort()


@contextlib.contextmanager
def _listening(port: int | None) -> Iterator[socket.socket]:
    """Open a port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as opened:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind((HOST, USUAL_PORT if port is None else port))
        except OSError as error:
            if port is not None:
                raise RequestError(
                    f"--port = {port} can't be opened ({error.strerror}); choose another one, or "
                    "leave it out for any that is free"
                ) from error
            opened.bind((HOST, 0))
        opened.listen()
        yield opened


def make_app(keys: Keys, plans: Plans, files: GivenFiles) -> FastAPI:
    """Return the application of a server."""

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async with plans.at_work():
            yield

    # FastAPI's own pages of documentation load scripts from elsewhere: `/api` is ours.
    app = FastAPI(
        title="RENEW",
        description="Plan voyages on this machine. Send the token of the server's first address "
        "as `Authorization: Bearer TOKEN`.",
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
        lifespan=lifespan,
    )
    app.add_middleware(Guard, keys=keys)
    _add_errors(app)
    _add_names(app)
    _add_plans(app, plans, files)
    _add_kept(app, plans)
    _add_results(app, plans)
    _add_given(app, files)
    _add_pages(app)
    return app


def _add_errors(app: FastAPI) -> None:
    """Answer every error with `{"faults": [...]}`."""

    async def invalid(_: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)  # noqa: S101 - it is called with no other
        faults = [
            f"{'.'.join(map(str, fault['loc'][1:])) or 'the body'}: {fault['msg']}"
            for fault in error.errors()[:10]
        ]
        return JSONResponse({"faults": faults}, status_code=422)

    async def failed(_: Request, error: Exception) -> Response:
        by_kind = (status for kind, status in _STATUS.items() if isinstance(error, kind))
        status = getattr(error, "status", next(by_kind))
        return JSONResponse({"faults": str(error).splitlines()}, status_code=status)

    async def unknown(_: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)  # noqa: S101 - it is called with no other
        return refused(error.status_code, error.detail, error.headers)

    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, unknown)
    app.add_exception_handler(PipelineError, failed)


# What a browser saves and does not open.
_ANY = "application/octet-stream"
_POLICY = "content-security-policy"
# The status of each error's answer, the particular ones first.
_STATUS: dict[type[PipelineError], int] = {RequestError: 422, StageError: 507, PipelineError: 500}


def _add_pages(app: FastAPI) -> None:
    """Serve the page with its scripts and styles, and a description of the interface."""

    def answer(content: bytes, kind: str) -> Callable[[], Response]:
        return lambda: Response(content, media_type=kind)

    for path, content in page_files(app.openapi()).items():
        kind = _TYPES[path.rpartition(".")[2] if "." in path else "html"]
        app.add_api_route(path, answer(content, kind), include_in_schema=False)


def page_files(interface: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the contents of the page's paths; `/api` describes an interface in OpenAPI."""
    templates = environment("pipeline.serve", "pipeline.formats.report")
    style = "\n".join(
        (
            appearance.leaflet_style(),
            *(
                templates.get_template(name).render(appearance.style_colours())
                for name in ("report.css", "explorer.css")
            ),
            (_HERE / "templates" / "plan.css").read_text("utf-8"),
        )
    )
    own = {
        f"/static/{path.name}": path.read_text("utf-8")
        for path in sorted((_HERE / "scripts").glob("*.js"))
    }
    shared = appearance.own_scripts()
    files = {
        "/": templates.get_template("plan.html.jinja").render(
            options={option.field: option for option in ASKED}
        ),
        "/api": templates.get_template("api.html.jinja").render(api=interface),
        "/static/style.css": style,
        "/static/leaflet.js": appearance.leaflet(),
        # The report's own scripts, made a module: their definitions are exported.
        "/static/map.js": f"{shared}\nexport {{ {', '.join(_DEFINED.findall(shared))} }};\n",
        **own,
    }
    return {path: content.encode() for path, content in files.items()}


def _add_names(app: FastAPI) -> None:
    """Serve the catalogue, positions and the land."""

    @app.get("/api/catalogue")
    def names() -> dict[str, Any]:
        """Vessels, sources of currents and stations of the tide, by name with their titles."""
        return {
            "vessels": {name: catalogue.vessel(name).label for name in catalogue.names("vessels")},
            "currents": {
                name: entry.title
                for name in catalogue.names("sources")
                if not isinstance(entry := catalogue.source(name), catalogue.ChartEntry)
            },
            "tides": list(catalogue.stations()),
        }

    @app.get("/api/position")
    def position(text: Annotated[str, Query(max_length=200)]) -> dict[str, Any]:
        """Longitude and latitude, degrees, of a position that is typed as for `renew go`."""
        try:
            place = read_position(text)
        except ValueError as error:
            raise RequestError(str(error)) from None
        return {"lon": place.lon, "lat": place.lat, "note": place.note}

    @app.get("/api/land/{zoom}/{column}/{row}")
    def land(zoom: int, column: int, row: int) -> Response:
        """Rings of the land in a tile of 512 pixels: x, y, x, y, ... in quarters of a pixel.

        Their coast is not sharp while the sharp one is prepared.
        """
        from pipeline.serve.land import tile  # loads for half a second

        try:
            rings, is_sharp = tile(zoom, column, row)
        except IndexError:
            return refused(404, "there is no such tile")
        kept = f"private, max-age={_TILE_S}" if is_sharp else "no-store"
        return JSONResponse({"rings": rings, "is_sharp": is_sharp}, headers={"cache-control": kept})


def _add_plans(app: FastAPI, plans: Plans, files: GivenFiles) -> None:
    """Serve requests to plan a voyage, to report a plan and to cancel it."""

    @app.post("/api/plan", status_code=202)
    async def add(request: PlanRequest) -> dict[str, Any]:
        """Plan a voyage; the answer has the `id` by which to ask how it goes."""
        options = await asyncio.to_thread(request.options, files)
        return state_of(plans, plans.add(request, options))

    @app.post("/api/prepare", status_code=204)
    async def prepare(request: PlanRequest) -> None:
        """Fetch land and currents of a voyage that may be planned soon, if nothing else is at work.

        Nothing is planned or reported.
        """
        plans.prepare(await asyncio.to_thread(request.options, files))

    @app.get("/api/plan")
    async def every() -> list[dict[str, Any]]:
        """All plans, the latest first, without their routes."""
        return [_brief(plan) for plan in plans.all()]

    @app.get("/api/plan/{identity}", response_model=None)
    async def state(identity: _Identity) -> dict[str, Any]:
        """How a plan goes: its state, the ways found so far, and its routes when they are known."""
        return state_of(plans, plans.get(identity))

    @app.delete("/api/plan/{identity}", response_model=None)
    async def cancel(identity: _Identity, *, forget: bool = False) -> dict[str, Any]:
        """Cancel a plan that waits or is at work; `forget` it, too: its files stay."""
        plan = plans.get(identity)
        plans.cancel(plan)
        if forget:
            plans.forget(plan)
        return state_of(plans, plan)


def _add_kept(app: FastAPI, plans: Plans) -> None:
    """Serve what is kept of plans: their names, and what the map draws."""

    @app.put("/api/plan/{identity}/title", response_model=None)
    async def entitle(identity: _Identity, title: _Title) -> dict[str, Any]:
        """Give a plan a name for the list of plans."""
        plan = plans.get(identity)
        plan.title = title
        plans.keep(plan)
        return _brief(plan)

    @app.get("/api/plan/{identity}/map", response_model=None)
    async def drawn(identity: _Identity) -> Response:
        """What the page's map draws of a plan, once its `maps` are counted."""
        plan = plans.get(identity, drawn=True)
        return FileResponse(plans.map_file(plan), media_type="application/json")


def _brief(plan: AskedPlan) -> dict[str, Any]:
    """Return a plan's row in a list."""
    kept = plan.kept()
    return {name: kept[name] for name in ("id", "state", "name", "title", "asked_at", "request")}


# What is told of a plan as it is.
_SHOWN = "stages", "detail", "notes", "sides", "maps", "faults", "files", "version"


def state_of(plans: Plans, plan: AskedPlan) -> dict[str, Any]:
    """Return how a plan goes, and its results."""
    return {
        **_brief(plan),
        "command": plans.command(plan),
        "before": plans.number_before(plan),
        **{name: getattr(plan, name) for name in _SHOWN},
        "drafts": [] if plan.sides else plan.drafts,
        "seconds": round(plan.seconds, 2),
    }


def _add_results(app: FastAPI, plans: Plans) -> None:
    """Serve the files of plans that ended, by their known names; nothing else is opened."""

    @app.get("/api/plan/{identity}/files/{name}", response_model=None)
    async def one_file(identity: _Identity, name: str) -> Response:
        """Download one file of a plan."""
        (file,) = _files(plans, identity, name)
        return FileResponse(file, filename=name, media_type=_ANY)

    @app.get("/api/plan/{identity}/files.zip", response_model=None)
    def all_files(identity: _Identity) -> Response:
        """Download all files of a plan."""
        files, name = _files(plans, identity), plans.get(identity).name
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for file in files:
                archive.write(file, f"{name}/{file.name}")
        kept = f'attachment; filename="{name}.zip"'
        return Response(
            packed.getvalue(), media_type="application/zip", headers={"content-disposition": kept}
        )

    @app.get("/plan/{identity}/report.html", include_in_schema=False, response_model=None)
    async def report(identity: _Identity) -> Response:
        """Show a plan's report; its scripts can ask nothing of this server."""
        (file,) = _files(plans, identity, "report.html")
        return FileResponse(file, headers={_POLICY: REPORT_POLICY})


def _files(plans: Plans, identity: str, name: str = "") -> list[Path]:
    """Return the files of a plan, or the one with a name; NotTakenError if one is missing."""
    files = [
        plan.directory / file
        for plan in plans.all()
        if plan.id == identity and plan.directory is not None
        for file in plan.files
        if file == (name or file)
    ]
    if not files or not all(file.is_file() for file in files):
        raise NotTakenError("there is no such file; if it was removed, plan the voyage again", 404)
    return files


def _add_given(app: FastAPI, files: GivenFiles) -> None:
    """Receive files: currents, charts, depths, areas, constants of the tide."""

    @app.post(FILES, status_code=201)
    async def receive(request: Request, name: Annotated[str, Query(max_length=200)]) -> Any:  # noqa: ANN401 - JSON
        """Send a file as the body; the answer has the `id` by which a plan names it."""
        if int(request.headers.get("content-length", "0")) > MAX_FILE_BYTES:
            raise NotTakenError(too_large(name), 413)
        path = await files.receive(name, request.stream())
        return {"id": path.parent.name, "name": path.name, "size": path.stat().st_size}
