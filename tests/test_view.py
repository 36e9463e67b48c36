"""The page of a run, served: who gets it, what edits do, and that nothing a browser does ends the server."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import iceg
from graph.errors import IcegError
from iceg.cli import main
from iceg.corrections.corrections import CorrectionsError
from iceg.maps.config import GridConfig
from iceg.results import RESULT_FILES
from iceg.run_folder import read_closures
from iceg.view.errors import ViewError
from iceg.view.server import PAGE, ViewServer
from iceg.view.session import CORRECTIONS, Session

CONFIG = iceg.Config(grid=GridConfig(resolution=0.2))
LATEST = ("trajectory.tum", "closures.csv", "map.pgm")


@pytest.fixture(scope="module")
def run_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("view") / "run"
    log = iceg.read_log(iceg.demo_log_path()).select(slice(260))
    iceg.write_results(iceg.run(log, CONFIG), directory)
    return directory


@pytest.fixture
def folder(run_once: Path, tmp_path: Path) -> Path:
    """A folder of its own of a run."""
    directory = tmp_path / "run"
    directory.mkdir()
    for name in RESULT_FILES:
        (directory / name).write_bytes((run_once / name).read_bytes())
    (directory / PAGE).write_text("<!doctype html><html><head><title>run</title></head><body>A map.</body></html>")
    return directory


@pytest.fixture
def server(folder: Path) -> Iterator[ViewServer]:
    with ViewServer(Session(folder)) as served:
        thread = threading.Thread(target=served.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield served
        served.shutdown()
        thread.join()


def ask(
    server: ViewServer, path: str, body: object = None, *, method: str | None = None, **headers: str | None
) -> tuple[int, bytes]:
    """What the server answers; headers that are None are not sent."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    sent: dict[str, str | None] = {"X-Iceg-Token": server.token, "Content-Type": "application/json"}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    content = body if isinstance(body, bytes | None) else json.dumps(body).encode()
    chosen = method or ("GET" if body is None else "POST")
    connection.request(chosen, path, content, {name: value for name, value in sent.items() if value is not None})
    response = connection.getresponse()
    found = response.status, response.read()
    connection.close()
    return found


def state(server: ViewServer) -> Any:
    status, content = ask(server, "/state")
    assert status == 200
    return json.loads(content)


def accepted(folder: Path) -> list[list[int]]:
    return [[c.scan_i, c.scan_j] for c in read_closures(folder / "closures.csv") if c.verdict == "accepted"]


def test_it_listens_on_this_machine_only(server: ViewServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    assert server.address == f"http://127.0.0.1:{server.server_port}/?token={server.token}"
    assert len(server.token) >= 32


def test_the_page_knows_that_it_is_served(server: ViewServer) -> None:
    status, content = ask(server, f"/?token={server.token}", X_Iceg_Token=None)
    assert status == 200
    told = content.split(b"window.icegServed = ")[1].split(b";</script>")[0]
    assert json.loads(told) == {"token": server.token, "state": state(server)}
    assert b"A map." in content


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=guessed", "/?token=%C3%A9"])
def test_without_the_token_there_is_no_page(server: ViewServer, path: str) -> None:
    status, content = ask(server, path)
    assert status == 403
    assert b"open the address" in content


@pytest.mark.parametrize(
    "headers",
    [
        {"X_Iceg_Token": None},
        {"X_Iceg_Token": "guessed"},
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ],
)
def test_others_can_neither_read_nor_edit(server: ViewServer, folder: Path, headers: dict[str, str | None]) -> None:
    assert ask(server, "/state", **headers)[0] == 403
    assert ask(server, "/forbid", {"revision": 0, "scans": accepted(folder)[0]}, **headers)[0] == 403
    assert state(server)["revision"] == 0


@pytest.mark.parametrize(
    "path",
    [
        "/summary.json",
        "/run.npz",
        "/report.html",
        "/../run/summary.json",
        "/../../../../etc/passwd",
        "/..%2f..%2fetc%2fpasswd",
        "/%2e%2e/secret.txt",
        "//etc/passwd",
        "/./secret.txt",
        "/state/../secret.txt",
        "file:///etc/passwd",
        "/\\..\\secret.txt",
    ],
)
def test_no_path_leads_to_a_file(server: ViewServer, folder: Path, path: str) -> None:
    (folder.parent / "secret.txt").write_text("secret")
    status, content = ask(server, f"{path}?token={server.token}")
    assert status in (400, 404)
    assert b"secret" not in content.replace(path.encode(), b"")
    assert b"root:" not in content


def test_a_page_that_is_a_link_out_of_the_folder_is_not_served(server: ViewServer, folder: Path) -> None:
    (folder.parent / "secret.html").write_text("<head>secret")
    (folder / PAGE).unlink()
    (folder / PAGE).symlink_to(folder.parent / "secret.html")
    status, content = ask(server, f"/?token={server.token}")
    assert status == 404
    assert b"secret" not in content
    (folder / PAGE).unlink()
    assert ask(server, f"/?token={server.token}")[0] == 404


@pytest.mark.parametrize(
    ("path", "body", "headers", "expected"),
    [
        ("/forbid", b"{", {}, 400),
        ("/forbid", b"[" * 60_000, {}, 400),
        ("/forbid", b"\xff\xfe", {}, 400),
        ("/forbid", b"[1, 2]", {}, 400),
        ("/forbid", b" " * 70_000, {}, 413),
        ("/forbid", b"{}", {"Content_Length": "-1"}, 413),
        ("/forbid", b"{}", {"Content_Length": "\u00b2"}, 413),
        ("/forbid", b"{}", {"Content_Type": "text/plain"}, 415),
        ("/erase", b"{}", {}, 404),
        ("/forbid", {}, {}, 409),
        ("/forbid", {"revision": 0}, {}, 422),
        ("/forbid", {"revision": 0, "scans": [1, 2, 3]}, {}, 422),
        ("/forbid", {"revision": 0, "scans": [1, "2]\n[map]"]}, {}, 422),
        ("/forbid", {"revision": 0, "scans": [1, 10**9]}, {}, 422),
        ("/forbid", {"revision": 0, "scans": [1, 5000]}, {}, 422),
        ("/forbid", {"revision": 0, "between": [[1, 2]]}, {}, 422),
        ("/forbid", {"revision": 0, "between": [[5, 2], [8, 9]]}, {}, 422),
        ("/add", {"revision": 0, "scans": [5, 5]}, {}, 422),
        ("/drag", {"revision": 0, "scans": [5, 50]}, {}, 422),
        ("/drag", {"revision": 0, "scans": [5, 50], "pose": [0, 0, None]}, {}, 422),
        ("/drag", {"revision": 0, "scans": [5, 50], "pose": [0, 0, 1e300]}, {}, 422),
        ("/pin", {"revision": 0, "scans": [True, False]}, {}, 422),
        ("/undo", {"revision": 0}, {}, 422),
    ],
)
def test_a_bad_request_is_told_why_and_changes_nothing(
    server: ViewServer, folder: Path, path: str, body: object, headers: dict[str, str], expected: int
) -> None:
    before = {name: (folder / name).read_bytes() for name in RESULT_FILES}
    status, content = ask(server, path, body, **headers)
    assert (status, bool(json.loads(content)["error"])) == (expected, True)
    assert {name: (folder / name).read_bytes() for name in RESULT_FILES} == before
    assert not (folder / CORRECTIONS).exists()
    assert state(server)["revision"] == 0


@pytest.mark.parametrize("method", ["PUT", "DELETE", "HEAD", "OPTIONS", "TRACE"])
def test_other_methods_are_refused(server: ViewServer, method: str) -> None:
    assert ask(server, "/forbid", method=method)[0] == 501


def test_forbid_and_undo(server: ViewServer, folder: Path) -> None:
    before = {name: (folder / name).read_bytes() for name in LATEST}
    scans = accepted(folder)[0]
    status, content = ask(server, "/forbid", {"revision": 0, "scans": scans})
    assert status == 200, content
    found = json.loads(content)
    assert (found["revision"], found["undo"]) == (1, 1)
    assert scans not in accepted(folder)
    assert (folder / CORRECTIONS).read_text() == found["corrections"] == f"[[forbid]]\nscans = {scans}\n"
    assert json.loads((folder / "summary.json").read_text())["corrections"]["forbidden"]
    undone = json.loads(ask(server, "/undo", {"revision": 1})[1])
    assert (undone["revision"], undone["undo"], undone["corrections"]) == (2, 0, "")
    assert {name: (folder / name).read_bytes() for name in LATEST} == before
    assert (folder / CORRECTIONS).read_text() == ""


def test_add_drag_and_pin(server: ViewServer, folder: Path) -> None:
    scans = accepted(folder)[-1]
    found = {}
    for revision, (kind, more) in enumerate([("pin", {}), ("add", {}), ("drag", {"pose": [3.0, 3.0, 0.5]})]):
        status, content = ask(server, f"/{kind}", {"revision": revision, "scans": scans, **more})
        assert status == 200, content
        found = json.loads(content)
    assert found["undo"] == 3
    (sentence,) = found["warnings"]
    assert "is inconsistent" in sentence
    assert f"scans {scans[0]} and {scans[1]}" in sentence
    reasons = [c.reason for c in read_closures(folder / "closures.csv") if [c.scan_i, c.scan_j] == scans]
    assert [reason.partition(";")[0] for reason in reasons] == ["pinned", "by hand, matched", "by hand"]


def test_what_was_corrected_before_stays_as_it_was_written(folder: Path) -> None:
    first, second, *_ = accepted(folder)
    written = f"# looks like the other corridor\n[[forbid]]\nscans = {first}"
    (folder / CORRECTIONS).write_text(written)
    session = Session(folder)
    assert first not in accepted(folder)
    session.edit("forbid", {"revision": 0, "scans": second})
    assert (folder / CORRECTIONS).read_text() == f"{written}\n\n[[forbid]]\nscans = {second}\n"
    session.edit("undo", {"revision": 1})
    assert (folder / CORRECTIONS).read_text() == f"{written}\n"
    assert first not in accepted(folder)
    assert second in accepted(folder)


def test_a_second_tab_is_told_that_it_is_behind(server: ViewServer, folder: Path) -> None:
    first, second, *_ = accepted(folder)
    assert ask(server, "/forbid", {"revision": 0, "scans": first})[0] == 200
    status, content = ask(server, "/forbid", {"revision": 0, "scans": second})
    behind = json.loads(content)
    assert status == 409
    assert "load it again" in behind["error"]
    assert behind["revision"] == 1
    assert second in accepted(folder)


def test_edits_at_the_same_time_are_made_one_after_the_other(server: ViewServer, folder: Path) -> None:
    answers: list[int] = []
    threads = [
        threading.Thread(
            target=lambda scans=scans: answers.append(ask(server, "/forbid", {"revision": 0, "scans": scans})[0])
        )
        for scans in accepted(folder)[:2]
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answers) == [200, 409]
    assert state(server)["revision"] == 1


def test_a_closed_browser_ends_nothing(server: ViewServer, folder: Path) -> None:
    half = b"POST /forbid HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 50\r\n\r\n{"
    scans = accepted(folder)[0]
    body = json.dumps({"revision": 0, "scans": scans})
    edit = (
        f"POST /forbid HTTP/1.1\r\nHost: 127.0.0.1:{server.server_port}\r\nX-Iceg-Token: {server.token}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n{body}"
    )
    for said in (b"", b"\x00\xff\n\n", b"GET /" + b"x" * 70_000, half, edit.encode()):
        with socket.create_connection(("127.0.0.1", server.server_port)) as connection:
            connection.sendall(said)
    # The last has asked for an edit and gone before it was answered: it is made.
    assert ask(server, "/undo", {"revision": 1})[0] in (200, 409)
    assert state(server)["revision"] in (1, 2)


def test_a_port_that_is_taken_is_told(server: ViewServer, folder: Path) -> None:
    with pytest.raises(ViewError, match=rf"127\.0\.0\.1:{server.server_port}: cannot be listened on"):
        ViewServer(server.session, server.server_port)
    assert main(["view", str(folder), "--port", "70000"]) == 2
    assert main(["view", str(folder / "nowhere"), "--no-browser"]) == 1


def test_corrections_that_cannot_be_read_are_told_at_once(folder: Path) -> None:
    (folder / CORRECTIONS).write_text("[[forbid]]\nscan = [1, 2]\n")
    with pytest.raises(IcegError, match=r"corrections\.toml:2: unknown key 'scan'"):
        Session(folder)


@pytest.mark.skipif(os.name != "posix", reason="signals are sent")
def test_ctrl_c_ends_it_well(folder: Path) -> None:
    command = [sys.executable, "-c", "from iceg.cli import command; command()", "view", str(folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "http://127.0.0.1:" in line
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, "Traceback" in err) == (0, False)
    assert "Nothing was corrected" in out


def test_a_closure_by_hand_is_taken_out_and_all_else_stays_as_written(folder: Path) -> None:
    first, second, third, *_ = accepted(folder)
    others = f"# the far corridor\n[[forbid]]\nscans = {first}\n\n"
    wrong = f"[[add]] # surely\nscans = {second}\npose = [3.0, 3.0, 0.5]\npin = true\n"
    more = f"[[add]]\nscans = {third}\n"
    (folder / CORRECTIONS).write_text(others + wrong + more)
    session = Session(folder)
    bent = (folder / "trajectory.tum").read_bytes()
    session.edit("withdraw", {"revision": 0, "scans": second[::-1]})
    assert (folder / CORRECTIONS).read_text() == others + more
    assert (folder / "trajectory.tum").read_bytes() != bent
    session.edit("undo", {"revision": 1})
    assert (folder / CORRECTIONS).read_text() == others + wrong + more
    assert (folder / "trajectory.tum").read_bytes() == bent
    with pytest.raises(CorrectionsError, match="found no closure by hand between scans"):
        session.edit("withdraw", {"revision": 2, "scans": first})


def test_a_closure_by_hand_that_is_written_otherwise_is_left_to_the_hand(folder: Path) -> None:
    first, second, *_ = accepted(folder)
    written = f"add = [{{scans = {first}}}, {{scans = {second}}}]\n\n[map]\nturn_degrees = 90\n"
    (folder / CORRECTIONS).write_text(written)
    session = Session(folder)
    with pytest.raises(CorrectionsError, match="take it out by hand"):
        session.edit("withdraw", {"revision": 0, "scans": first})
    assert (folder / CORRECTIONS).read_text() == written


def test_corrections_that_a_run_was_given_are_not_lost(folder: Path, tmp_path: Path) -> None:
    first, second, *_ = accepted(folder)
    given = tmp_path / "mine.toml"
    given.write_text(f"[[forbid]]\nscans = {first}\n")
    main(["run", str(iceg.demo_log_path()), "-o", str(tmp_path / "given"), "--corrections", str(given), "--no-report"])
    assert (tmp_path / "given" / CORRECTIONS).read_text() == given.read_text()
    (tmp_path / "given" / CORRECTIONS).unlink()
    session = Session(tmp_path / "given")
    with pytest.raises(CorrectionsError, match=f"put them there as {CORRECTIONS}"):
        session.edit("forbid", {"revision": 0, "scans": second})


def test_corrections_of_an_earlier_run_are_told_of(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / CORRECTIONS).write_text("[map]\nupright = true\n")
    short = tmp_path / "short.csv"
    iceg.write_log(short, iceg.read_log(iceg.demo_log_path()).select(slice(60)))
    assert main(["run", str(short), "-o", str(folder), "--overwrite", "--no-report"]) == 0
    assert f"{folder / CORRECTIONS} was there before and corrects nothing of this run" in capsys.readouterr().err
