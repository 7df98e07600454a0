"""Plans over real HTTP: the same routes as on the command line; limits, cancelling, and death."""

import io
import os
import re
import shlex
import signal
import subprocess
import time
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.serve.app import REPORT_POLICY
from tests.commands import ended
from tests.pipeline.processes import descendants, ends_within, renew, wait_until
from tests.pipeline.serve.client import AREA, LONG, VOYAGE, Server, serving


def memory_bytes(process_id: int) -> int:
    """Memory of a process and all that it started; what they share counts once."""
    shares = (
        re.search(r"^Pss: +(\d+) kB", Path(f"/proc/{one}/smaps_rollup").read_text(), re.MULTILINE)
        for one in (process_id, *descendants(process_id))
    )
    return sum(1024 * int(share[1]) for share in shares if share)


def workers(server: Server) -> set[int]:
    """Ids of the server's worker processes."""
    return {
        one
        for one in descendants(server.process.pid)
        if "pipeline.machine.workers" in Path(f"/proc/{one}/cmdline").read_text()
    }


def running(server: Server, identity: str) -> bool:
    """Whether a plan is at work, and not merely begun."""
    return bool(server.state(identity)["stages"])


def answered(server: Server) -> str:
    """What a worker answers to a voyage that it can't plan: there is one that works."""
    return " ".join(server.ended(server.begin({**VOYAGE, "start": "nowhere"}))["faults"])


def test_a_plan_tells_its_sides_and_why(server: Server, planned: dict[str, Any]) -> None:
    assert (planned["state"], planned["faults"]) == ("done", [])
    (season,) = planned["sides"]["seasons"]
    best, other = (one for one in season["routes"] if one["is_side"])
    assert best["side"] != other["side"]
    assert best["excess"] == 0 < other["excess"]
    for route in (best, other):
        assert "than" in route["because"]
        assert route["clearance_m"] > 0
        assert route["duration_s"] == pytest.approx(route["length_m"] / (8 * 1852 / 3600), rel=2e-3)
        assert route["line"][0] == pytest.approx([-40.06, 35.0], abs=1e-4)
        assert route["line"][-1] == pytest.approx([-39.94, 35.0], abs=1e-4)
    assert planned["stages"][-1] == "write"
    assert server.state(planned["id"])["request"] == planned["request"]


@pytest.mark.usefixtures("plain_report")
def test_the_command_line_gives_the_same_routes_byte_for_byte(
    server: Server, planned: dict[str, Any], tmp_path: Path
) -> None:
    program, go, *options = shlex.split(planned["command"])
    assert (program, go) == ("renew", "go")
    options[options.index("--output") + 1] = str(tmp_path)
    done = CliRunner().invoke(app, ["go", *options])
    assert done.exit_code == 0, done.stderr
    ours, theirs = server.output / planned["name"], tmp_path / planned["name"]
    assert sorted(one.name for one in theirs.iterdir()) == planned["files"]
    compared = [*theirs.glob("*.geojson"), theirs / "metrics.csv", *theirs.glob("*.waypoints")]
    assert len(compared) == 3
    for file in compared:
        assert (ours / file.name).read_bytes() == file.read_bytes(), file.name


@pytest.mark.slow
def test_twenty_random_voyages_are_the_same_on_the_page_and_on_the_command_line(
    server: Server, tmp_path: Path
) -> None:
    for number, request in enumerate(random_voyages(server, 20)):
        plan = server.ended(server.begin(request), 600)
        options = shlex.split(plan["command"])[2:]
        options[options.index("--output") + 1] = str(tmp_path)
        done = subprocess.run(renew("go", *options), check=False, capture_output=True, timeout=600)
        assert (done.returncode == 0) == (plan["state"] == "done"), (number, request, plan)
        if plan["state"] == "done":
            ours, theirs = server.output / plan["name"], tmp_path / plan["name"]
            compared = [*theirs.glob("*.geojson"), *theirs.glob("*.waypoints")]
            assert compared
            for file in (*compared, theirs / "metrics.csv"):
                assert (ours / file.name).read_bytes() == file.read_bytes(), (number, file.name)


def random_voyages(server: Server, count: int) -> Iterator[dict[str, Any]]:
    """Yield voyages past drawn islands and areas, in still water and in currents of the catalogue.

    Half of them lie around an island of a given chart, half off Palawan and Korea.
    """
    draw = np.random.default_rng(40)
    vessel = {"speed": "8kn", "length": "12m", "turning_circle": "40m"}
    for number in range(count):
        if number % 2:
            chart = shapely.to_geojson(
                shapely.MultiPolygon(
                    [
                        shapely.box(x, y, x + draw.uniform(0.005, 0.02), y + draw.uniform(0, 0.02))
                        for x, y in zip((-40.03, -39.99), draw.uniform(34.98, 35.0, 2), strict=True)
                    ]
                )
            )
            yield {
                **vessel,
                "start": f"{draw.uniform(34.98, 35.02):.4f}N 40.06W",
                "goal": f"{draw.uniform(34.98, 35.02):.4f}N 39.94W",
                "currents": ["still"],
                "via": ["35.03N 40.0W"] * (number % 3 == 0),
                "areas": [AREA] * (number % 4 == 1),
                "charts": server.give(chart.encode(), f"islands-{number}.geojson"),
            }
        else:
            west, south, month = ((118.9, 9.9, "2024-07"), (128.3, 34.65, "2024-01"))[
                draw.integers(2)
            ]
            yield {
                **vessel,
                "start": f"{west + draw.uniform(0, 0.1):.4f},{south + draw.uniform(0, 0.05):.4f}",
                "goal": f"{west + draw.uniform(0.3, 0.4):.4f},{south + draw.uniform(0, 0.1):.4f}",
                "month": [month],
            }


def test_files_are_downloaded_as_they_are_and_the_report_is_shut_in(
    server: Server, planned: dict[str, Any]
) -> None:
    folder = server.output / planned["name"]
    archive = server.ask("GET", f"/api/plan/{planned['id']}/files.zip")
    with zipfile.ZipFile(io.BytesIO(archive.content)) as packed:
        assert sorted(packed.namelist()) == [f"{planned['name']}/{one}" for one in planned["files"]]
    for name in planned["files"]:
        answer = server.ask("GET", f"/api/plan/{planned['id']}/files/{name}")
        assert answer.content == (folder / name).read_bytes()
        assert answer.headers["content-disposition"].startswith("attachment")
    report = server.ask("GET", f"/plan/{planned['id']}/report.html")
    assert report.content == (folder / "report.html").read_bytes()
    assert report.headers["content-security-policy"] == REPORT_POLICY
    assert "allow-same-origin" not in REPORT_POLICY
    secret = server.output / "secret.txt"
    secret.write_text("secret")
    for name in ("../secret.txt", "..%2fsecret.txt", "secret.txt", "%2e%2e/secret.txt"):
        assert server.ask("GET", f"/api/plan/{planned['id']}/files/{name}").status == 404


def test_the_same_request_is_planned_once(server: Server, planned: dict[str, Any]) -> None:
    assert server.begin({**server.island(), "areas": [AREA]}) == planned["id"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"goal": "35.0N 40.0W"}, "lies"),  # on the island
        ({"start": "nowhere"}, "nowhere"),
        ({"currents": [], "month": ["2024-13"]}, "2024-13"),
        ({"speed": "fast"}, "fast"),
    ],
)
def test_wrong_input_is_told(server: Server, change: dict[str, Any], said: str) -> None:
    plan = server.ended(server.begin({**server.island(), **change}))
    assert plan["state"] == "failed"
    assert said in " ".join(plan["faults"])
    assert plan["sides"] is None


def test_a_file_that_is_no_file_of_currents_is_told(server: Server) -> None:
    rubbish = server.give(b"\x89HDF\r\n\x1a\n" + bytes(1000), "rubbish.nc")
    plan = server.ended(server.begin({**VOYAGE, "currents": [rubbish], "month": ["2024-07"]}))
    assert plan["state"] == "failed"
    assert "rubbish.nc" in " ".join(plan["faults"])


def test_a_plan_is_cancelled_and_its_process_ends(server: Server) -> None:
    identity = server.begin(LONG)
    waiting = server.begin({**LONG, "goal": "116.81,7.70"})
    wait_until(lambda: running(server, identity))
    before = workers(server)
    for one in (waiting, identity):
        assert server.ask("DELETE", f"/api/plan/{one}").json["state"] == "cancelled"
    wait_until(lambda: len(before - workers(server)) == 1, 5)
    assert "nowhere" in answered(server)
    assert server.state(waiting)["state"] == "cancelled"


def test_a_plan_that_ended_is_not_cancelled(server: Server, planned: dict[str, Any]) -> None:
    assert server.ask("DELETE", f"/api/plan/{planned['id']}").json["state"] == "done"


@pytest.mark.slow
def test_a_worker_that_is_killed_fails_its_plan_alone(server: Server) -> None:
    identity = server.begin({**LONG, "goal": "116.82,7.70"})
    wait_until(lambda: running(server, identity))
    for worker in workers(server):  # the spare one, too
        os.kill(worker, signal.SIGKILL)
    plan = server.ended(identity)
    assert plan["state"] == "failed"
    assert "ended with code -9" in plan["faults"][0]
    assert "nowhere" in answered(server)


def test_a_route_of_ones_own_is_checked(server: Server, planned: dict[str, Any]) -> None:
    """The plan's own file is as long as the plan says, safe, and the least of its side."""
    best = planned["sides"]["seasons"][0]["routes"][0]
    name = next(one for one in planned["files"] if one.endswith(".geojson"))
    file = server.ask("GET", f"/api/plan/{planned['id']}/files/{name}").content
    asked = {**server.island(), "areas": [AREA], "route": server.give(file, name)}
    found = server.ended(server.begin({**asked, "start": "", "goal": ""}))
    assert (found["state"], found["faults"]) == ("done", [])
    (season,) = found["sides"]["seasons"]
    assert season["routes"][0]["length_m"] == pytest.approx(best["length_m"], rel=1e-5)
    first, *said = season["checked"]
    assert "GeoJSON" in first
    assert any(line.endswith("hard-over turns are clear of land") for line in said)
    assert any("the least-fuel route of its side" in line for line in said)
    damaged = {**asked, "route": server.give(b"<gpx", "damaged.gpx"), "start": "", "goal": ""}
    assert "damaged.gpx" in server.ended(server.begin(damaged))["faults"][0]
    assert server.ask("POST", "/api/plan", {**damaged, "route": "0" * 16}).status == 422


def test_hundreds_of_plans_at_once_are_refused_but_for_a_few(server: Server) -> None:
    def ask(number: int) -> tuple[int, Any]:
        answer = server.ask("POST", "/api/plan", {**LONG, "goal": f"116.83,{7.7 + number / 1e4}"})
        return answer.status, answer.json if answer.status in {202, 429} else None

    with ThreadPoolExecutor(100) as pool:
        answers = list(pool.map(ask, range(300)))
    taken = [told["id"] for status, told in answers if status == 202]
    assert 1 <= len(taken) <= 9  # one at work, eight that wait
    assert {status for status, _ in answers} <= {202, 429, 503}
    assert server.ask("GET", "/").status == 200
    assert memory_bytes(server.process.pid) < 1.4e9
    for identity in taken:
        server.ask("DELETE", f"/api/plan/{identity}")
    assert {server.state(one)["state"] for one in taken} == {"cancelled"}


def test_a_voyage_is_prepared(server: Server) -> None:
    voyage = {**server.island(), "speed": "9kn"}
    waters = server.output / ".artefacts" / "project"
    before = [*waters.glob("*")]
    assert server.ask("POST", "/api/prepare", voyage).status == 204
    wait_until(lambda: len([*waters.glob("*")]) > len(before))
    plans = server.ask("GET", "/api/plan").json
    assert "9kn" not in {plan["request"]["speed"] for plan in plans}
    assert server.ask("POST", "/api/prepare", {**voyage, "vessel": "none"}).status == 422


@pytest.mark.slow
def test_another_voyage_need_not_wait_for_one_that_is_prepared(tmp_path: Path) -> None:
    with serving(tmp_path / "outputs") as server:
        voyage = {**server.island(), "speed": "9kn"}
        assert server.ask("POST", "/api/prepare", voyage).status == 204
        wait_until(lambda: [*(server.output / ".artefacts").glob("project/*")])
        before = workers(server)

        def spare_one_takes_over() -> bool:
            assert server.ask("POST", "/api/prepare", LONG).status == 204
            time.sleep(0.5)  # its worker has begun by then, unless this machine is busy
            assert "nowhere" in answered(server)
            return len(before - workers(server)) == 1

        wait_until(spare_one_takes_over)
        assert server.ended(server.begin(voyage))["state"] == "done"


@pytest.mark.slow
def test_a_plan_that_takes_too_long_is_stopped(tmp_path: Path) -> None:
    with serving(tmp_path / "outputs", "--limit", "1") as server:
        plan = server.ended(server.begin(LONG))
        assert plan["state"] == "failed"
        assert "longer than 1 s" in plan["faults"][0]
        left = workers(server)
        server.process.send_signal(signal.SIGINT)
        assert server.process.wait(10) == 130
        assert all(ends_within(one, 5) for one in left)


@pytest.mark.slow
def test_workers_end_with_a_server_that_is_killed(tmp_path: Path) -> None:
    with serving(tmp_path / "outputs") as server:
        wait_until(lambda: workers(server))
        left = workers(server)
        server.process.kill()
        assert all(ends_within(one, 10) for one in left)


@pytest.mark.slow
def test_a_port_that_is_taken_is_told(server: Server) -> None:
    command = renew("serve", "--port", str(server.port))
    done = ended(*command)
    assert done.returncode == 2
    assert f"--port = {server.port} can't be opened" in done.stderr
