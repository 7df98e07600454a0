"""The guard: only this machine's own page or program, with the server's token, is answered.

Every request passes here first. A request that is refused reaches neither a file nor a plan:

- the Host must be the server's own (a foreign name that resolves to 127.0.0.1 is refused: 421);
- a request from another page, which names its Origin or its site, is refused: 403;
- the first address holds a token, which is exchanged for a cookie that scripts can't read and other
  sites can't send; a program sends the token as `Authorization: Bearer`. Without: 401;
- a body tells its length (411), and is at most 1 MB (413), except that of a file.
"""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY_BYTES = 1_000_000
"""Largest body of a request that is not a file."""
FILES = "/api/files"
"""The path to which files are sent; they are counted there as they come."""

# Scripts, styles and data from here alone, in no frame. Leaflet's pictures are data.
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# Headers of every answer that does not set them itself.
_HEADERS = {
    "content-security-policy": _POLICY,
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}


@dataclass(frozen=True)
class Keys:
    """What opens a server at a port: the token of its first address, and the cookie's value."""

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    cookie: str = field(default_factory=lambda: secrets.token_urlsafe(32))

    @property
    def cookie_name(self) -> str:
        """The cookie's name, with the port: browsers send a host's cookies to all its ports."""
        return f"renew-{self.port}"

    @property
    def hosts(self) -> frozenset[str]:
        """The values that the header Host may have."""
        return frozenset(f"{name}:{self.port}" for name in ("127.0.0.1", "localhost"))

    @property
    def address(self) -> str:
        """The first address."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def opens(self, headers: Headers) -> bool:
        """Whether a request has the cookie or the token."""
        scheme, _, given = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return _is_same(given.strip(), self.token)
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return False
        return self.cookie_name in cookies and _is_same(
            cookies[self.cookie_name].value, self.cookie
        )


def _is_same(given: str, key: str) -> bool:
    """Compare two keys in a time that does not depend on where they differ."""
    return secrets.compare_digest(given.encode(), key.encode())


class Guard:
    """Lets a request through to `app` if it may ask (see the module)."""

    def __init__(self, app: ASGIApp, keys: Keys) -> None:
        self._app, self._keys = app, keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # a web socket: there is none
            await send({"type": "websocket.close", "code": 1008})
            return

        async def say(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await refusal(scope, receive, say)
        else:
            await self._app(scope, receive, say)

    def _refusal(self, scope: Scope) -> Response | None:
        """Return a refusal, or the cookie for the first address; None lets the request through."""
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0] not in self._keys.hosts:
            return refused(421, "this server answers to 127.0.0.1 and localhost only")
        origins, site = headers.getlist("origin"), headers.get("sec-fetch-site", "none")
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return refused(403, "requests from other pages are refused")
        if site not in {"same-origin", "none"}:
            return refused(
                403, "a link from another page is refused; paste the address into the address bar"
            )
        if scope["path"] == "/" and scope["method"] == "GET" and scope["query_string"]:
            return self._exchanged(scope["query_string"])
        if not self._keys.opens(headers):
            return refused(
                401, "no token: open the address that `renew serve` printed, or send its token"
            )
        return None if scope["path"] == FILES else _refused_body(headers)

    def _exchanged(self, query: bytes) -> Response:
        """Return a cookie in exchange for the token of the first address."""
        given = parse_qs(query.decode("latin-1")).get("token", [""])[0]
        if not _is_same(given, self._keys.token):
            return refused(401, "not this server's token: open the address that it printed")
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(
            self._keys.cookie_name, self._keys.cookie, httponly=True, samesite="strict", path="/"
        )
        return answer


def _refused_body(headers: Headers) -> Response | None:
    """Refuse a body that is too long, or without its length; the HTTP server reads no more."""
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers or not length.isdecimal():
        return refused(411, "send the length of the body, as content-length")
    if int(length) > MAX_BODY_BYTES:
        text = f"the body is longer than {MAX_BODY_BYTES:,} bytes; send files to {FILES}"
        return refused(413, text)
    return None


def refused(status: int, fault: str, headers: Mapping[str, str] | None = None) -> Response:
    """Return a refusal with its reason."""
    return JSONResponse({"faults": [fault]}, status_code=status, headers=headers)
