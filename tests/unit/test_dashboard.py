"""Optuna's dashboard shows a study while it goes on, and no request changes it."""

from __future__ import annotations

import json
import socket
import threading
from contextlib import contextmanager
from http.client import HTTPConnection
from typing import TYPE_CHECKING, Any

import pytest

from fin_optimizer.commands import dashboard
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.file_names import JOURNAL_FILE
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome, Result

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MODULUS = "fin.young_modulus"


@pytest.fixture
def study(tmp_path: Path) -> Iterator[Study]:
    with Study.create(tmp_path / "study", Settings(Space((Dimension(MODULUS, 0.5e9, 4e9, "Pa"),)))) as study:
        swim(study)
        yield study


def swim(study: Study) -> None:
    number = len(study.trials)
    record = study.start(study.propose(number, {MODULUS: 1e9 + 1e8 * number}).number)
    (study.folder / record.bag).mkdir()
    study.finish(record.number, Result(Outcome.OK, measured={"mean_speed": 0.02}, samples=100))


@contextmanager
def shown(folder: Path) -> Iterator[HTTPConnection]:
    with dashboard.served(folder, "localhost", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        connection = HTTPConnection("localhost", server.server_port, timeout=60)
        try:
            yield connection
        finally:
            connection.close()
            server.shutdown()
            thread.join()


def ask(connection: HTTPConnection, method: str, path: str, body: str = "{}") -> tuple[int, Any]:
    connection.request(method, path, body if method != "GET" else None, {"Content-Type": "application/json"})
    answer = connection.getresponse()
    return answer.status, json.loads(answer.read())


def test_the_dashboard_shows_a_study_that_goes_on_and_refuses_each_request_that_would_change_it(study: Study) -> None:
    with shown(study.folder) as connection:
        before = (study.folder / JOURNAL_FILE).read_bytes()
        code, studies = ask(connection, "GET", "/api/studies")
        assert (code, [each["study_name"] for each in studies["study_summaries"]]) == (200, ["study"])
        number = studies["study_summaries"][0]["study_id"]
        for method, path in (
            ("DELETE", f"/api/studies/{number}"),
            ("POST", "/api/studies"),
            ("POST", f"/api/studies/{number}/rename"),
            ("PUT", f"/api/studies/{number}/note"),
            ("POST", "/api/trials/0/tell"),
        ):
            code, said = ask(connection, method, path)
            assert code == 403
            assert "only shows the study" in said["reason"]
        assert (study.folder / JOURNAL_FILE).read_bytes() == before
        swim(study)
        code, told = ask(connection, "GET", f"/api/studies/{number}?after=0")
        assert code == 200
        assert [trial["values"] for trial in told["trials"]] == [[0.02], [0.02]]


def test_a_folder_without_a_study_and_a_port_in_use_are_told(
    study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dashboard.main([str(tmp_path)]) == 2
    assert "holds no study" in capsys.readouterr().err
    with socket.create_server(("localhost", 0)) as taken:
        port = taken.getsockname()[1]
        assert dashboard.main([str(study.folder), "--port", str(port)]) == 2
        assert f"cannot listen at localhost:{port}: Address already in use" in capsys.readouterr().err
    assert dashboard.main([str(study.folder), "--port", "70000"]) == 2
    assert "--port = 70000 is outside the allowed range [0, 65535]; 0 takes any" in capsys.readouterr().err
