"""Hostile requests, over real HTTP: they plan nothing, read no file, and the server lives on."""

import socket
from collections.abc import Iterator
from http.cookies import SimpleCookie

import pytest

from pipeline.serve.guard import MAX_BODY_BYTES
from pipeline.serve.plans import MAX_FILE_BYTES
from tests.pipeline.serve.client import VOYAGE, Server, serving

PATHS = (
    *("/", "/static/page.js", "/api/plan", "/api/catalogue", "/api", "/api/openapi.json"),
    *("/api/land/0/0/0", "/api/position?text=1,1", f"/api/plan/{'0' * 32}"),
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, rehearsed: None) -> Iterator[Server]:
    """A server of its own: what a page asked another for may still be under way."""
    del rehearsed
    with serving(tmp_path_factory.mktemp("guard") / "outputs") as server:
        yield server
        assert server.ask("GET", "/api/plan").json == [], "something was planned"


@pytest.mark.parametrize("path", PATHS)
def test_without_the_token_nothing_is_answered(server: Server, path: str) -> None:
    assert server.send("GET", path).status == 401
    for wrong in ("Bearer ", "Bearer wrong", f"Basic {server.token}", "Bearer \N{SNOWMAN}"):
        given = {"Authorization": wrong.encode().decode("latin-1")}
        assert server.send("GET", path, headers=given).status == 401
    for wrong in ("renew=1", f"renew-{server.port}={server.token}", "renew-1=; =", "\x01"):
        assert server.send("GET", path, headers={"Cookie": wrong}).status in {400, 401}
    assert server.ask("GET", path).status in {200, 404}


def test_a_page_describes_the_whole_interface(server: Server) -> None:
    page = server.ask("GET", "/api").content.decode()
    for path, methods in server.ask("GET", "/api/openapi.json").json["paths"].items():
        for method in methods:
            assert f"{method.upper()} {path}<" in page
    assert "<code>start</code>: string, required" in page
    assert "<script" not in page


def test_without_the_token_nothing_is_planned_taken_or_cancelled(server: Server) -> None:
    body = '{"start": "1,1", "goal": "2,2"}'
    for method, path in (
        *(("POST", "/api/plan"), ("POST", "/api/files?name=a.nc")),
        *(("DELETE", f"/api/plan/{'0' * 32}"), ("OPTIONS", "/api/plan"), ("PUT", "/api/plan")),
    ):
        assert server.send(method, path, body).status == 401


def test_the_first_address_is_exchanged_for_a_cookie_that_scripts_cannot_read(
    server: Server,
) -> None:
    answer = server.send("GET", f"/?token={server.token}")
    assert (answer.status, answer.headers["location"]) == (303, "/")
    cookie = SimpleCookie(answer.headers["set-cookie"])[f"renew-{server.port}"]
    assert cookie["httponly"]
    assert cookie["samesite"].lower() == "strict"
    assert not cookie["domain"]
    assert server.token not in answer.headers["set-cookie"]
    given = {"Cookie": f"renew-{server.port}={cookie.value}"}
    assert server.send("GET", "/", headers=given).status == 200
    for wrong in ("", "x", f"{server.token}x", "%00", server.token[:-1]):
        assert server.send("GET", f"/?token={wrong}").status == 401
    assert server.send("GET", "/?other=1").status == 401


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:{port}", "[::1]:{port}"],
)
def test_another_host_is_refused_even_with_the_token(server: Server, host: str) -> None:
    headers = {"Host": host.format(port=server.port)}
    assert server.ask("GET", "/api/plan", headers=headers).status == 421
    assert server.ask("POST", "/api/plan", VOYAGE, headers).status == 421
    assert server.send("GET", f"/?token={server.token}", headers=headers).status == 421
    assert server.ask("GET", "/", headers={"Host": f"localhost:{server.port}"}).status == 200


def test_two_hosts_are_refused(server: Server) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        lines = (
            *("GET /api/plan HTTP/1.1", f"Host: 127.0.0.1:{server.port}", "Host: evil.example"),
            *(f"Authorization: Bearer {server.token}", "Connection: close"),
        )
        connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        assert connection.recv(100).split()[1] in {b"400", b"421"}


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "http://localhost:{port}"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_another_page_is_refused_even_with_the_token(
    server: Server, headers: dict[str, str]
) -> None:
    given = {name: value.format(port=server.port) for name, value in headers.items()}
    for method, path in (
        ("GET", "/api/plan"),
        ("POST", "/api/plan"),
        ("POST", "/api/files?name=a"),
    ):
        assert server.ask(method, path, VOYAGE if method == "POST" else None, given).status == 403
    own = {"Origin": f"http://127.0.0.1:{server.port}", "Sec-Fetch-Site": "same-origin"}
    assert server.ask("GET", "/api/plan", headers=own).status == 200


def test_every_answer_forbids_what_the_page_does_not_need(server: Server) -> None:
    for answer in (
        *(server.ask("GET", "/"), server.send("GET", "/"), server.ask("GET", "/api/none")),
        *(server.ask("POST", "/api/plan", {}), server.ask("GET", "/static/page.js")),
    ):
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'; script-src 'self'; style-src 'self'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert "access-control-allow-origin" not in answer.headers


def test_a_body_that_is_too_long_is_refused_said_or_not(server: Server) -> None:
    long = b'{"start": "' + b"1" * MAX_BODY_BYTES + b'"}'
    assert server.ask("POST", "/api/plan", long).status == 413
    chunks = iter([b"1" * 65_536] * 20)
    assert server.ask("POST", "/api/plan", chunks).status == 411  # chunked: no length is said
    lying = {"Content-Length": "-5"}
    assert server.ask("POST", "/api/plan", b"", lying).status in {400, 411}


def test_a_file_that_is_too_large_is_refused_and_nothing_is_left(server: Server) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        lines = (
            "POST /api/files?name=big.nc HTTP/1.1",
            f"Host: 127.0.0.1:{server.port}",
            f"Authorization: Bearer {server.token}",
            f"Content-Length: {MAX_FILE_BYTES + 1}",
        )
        connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        assert connection.recv(100).split()[1] == b"413"
    assert list(server.output.glob(".given/*.part")) == []


@pytest.mark.parametrize(
    "name",
    [
        *("../../etc/passwd", "/etc/passwd", "..", ".", "a/b", "a\\b", ".bashrc", "-rf"),
        *("a%00b", "a%0ab", "%2e%2e%2fx", "", "x" * 101, "a;b", "$(id)", "%F0%9F%9A%80", "a'b"),
    ],
)
def test_the_name_of_a_file_has_no_path(server: Server, name: str) -> None:
    before = sorted(server.output.parent.rglob("*"))
    plain = name.replace("\\", "%5C").replace("'", "%27")
    assert server.ask("POST", f"/api/files?name={plain}", b"content").status == 422
    assert sorted(server.output.parent.rglob("*")) == before


@pytest.mark.parametrize(
    "change",
    [
        {"vessel": "/etc/passwd"},
        {"vessel": "../vessel.toml", "speed": ""},
        {"currents": ["/etc/passwd"]},
        {"currents": ["*.nc"]},
        {"currents": ["0123456789abcdef"]},
        {"charts": "../../chart.shp"},
        {"charts": "0123456789abcdef"},
        {"depths": "file:///etc/passwd"},
        {"avoid": ["/etc/passwd"]},
        {"havens": "/etc/passwd"},
        {"tide": ["boston", "./station.json"]},
        {"output": "elsewhere"},
        {"name": "../escape"},
        {"offline": False},
        {"start": ["1", "2"]},
        {"via": ["1,1"] * 21},
        {"month": ["2024-07"] * 13},
        {"areas": [[[0, 0], [1, 1]]]},
        {"areas": [[[0, 0], [1, 1], [1, 1e9]]]},
        {"start": "x" * 201},
    ],
)
def test_a_request_names_no_path_and_keeps_to_its_keys(
    server: Server, change: dict[str, object]
) -> None:
    answer = server.ask("POST", "/api/plan", {**VOYAGE, **change})
    assert answer.status == 422
    assert answer.json["faults"]
    assert b"root:" not in answer.content


@pytest.mark.parametrize(
    "body",
    [
        *(b"", b"{", b"[]", b"null", b'{"start": NaN}', b"\xff\xfe", b"1" * 999),
        *(b'{"start": "\xed\xa0\x80"}', b'"\\ud800"'),
    ],
)
def test_what_is_no_request_is_refused(server: Server, body: bytes) -> None:
    answer = server.ask("POST", "/api/plan", body)
    assert answer.status in {400, 422}
    assert set(answer.json) == {"faults"}
    assert answer.json["faults"]


def test_files_of_results_are_named_exactly(server: Server) -> None:
    for path in (
        *(f"/api/plan/{'0' * 32}/files/report.html", f"/plan/{'0' * 32}/report.html"),
        *("/static/../guard.py", "/static/%2e%2e/guard.py", "/static/none.js", "//etc/passwd"),
        *(f"/api/plan/{'0' * 32}/files/..%2f..%2fetc%2fpasswd", f"/api/plan/{'0' * 32}/files.zip"),
    ):
        assert server.ask("GET", path).status == 404
    for tile in ("0/1/0", "-1/0/0", "15/0/0", "2/4/0", "2/0/-1"):
        assert server.ask("GET", f"/api/land/{tile}").status == 404
    assert server.ask("GET", "/api/land/a/0/0").status == 422
