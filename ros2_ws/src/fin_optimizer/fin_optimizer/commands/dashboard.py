"""Command ``dashboard``: a study in Optuna's dashboard, live, without a way to change it."""

from __future__ import annotations

import argparse
import json
import sys
from socketserver import ThreadingMixIn
from typing import TYPE_CHECKING, Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from fin_optimizer.study.file_names import JOURNAL_FILE
from fin_optimizer.study.journal import JournalLines, StudyError
from fin_plant import checks
from fin_plant.command import command
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from optuna.storages import JournalStorage

    Application = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]

PORT = 8080
_HIGHEST_PORT = 65535
_READING = {"GET", "HEAD"}
_REFUSAL = "this page only shows the study: what is changed here would be lost to it, or spoil it"


@command("dashboard", when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Serve the dashboard until Ctrl-C; return 2 if there is no study, or the port cannot be used."""
    parser = argparse.ArgumentParser(
        prog="dashboard",
        description="Show a study in Optuna's dashboard, live while it is under way. The page reads the journal and "
        "changes nothing. `optuna-dashboard` on the journal itself can delete the study.",
    )
    parser.add_argument("study", type=given_path, metavar="STUDY", help="its folder")
    parser.add_argument("--host", default="localhost", help="address to listen at (default: %(default)s)")
    parser.add_argument("--port", type=checks.read_whole_number, default=PORT, help="default: %(default)s")
    given = parser.parse_args(arguments)
    try:
        checks.whole_number("--port", given.port, 0, _HIGHEST_PORT, advice="0 takes any that is free")
        server = served(given.study, given.host, given.port)
    except OSError as error:
        msg = f"cannot listen at {given.host}:{given.port}: {error.strerror or error}; give another --host or --port"
        raise ValueError(msg) from None
    with server:
        sys.stdout.write(f"study {given.study}: http://{given.host}:{server.server_port} until Ctrl-C\n")
        sys.stdout.flush()
        server.serve_forever()
    return 0


def served(folder: Path, host: str, port: int) -> WSGIServer:
    """Return a server that listens, and is yet to be run, for the study in a folder.

    Raises:
        StudyError: There is no study, or its journal cannot be read.
        OSError: The address cannot be listened at.
    """
    import optuna_dashboard  # noqa: PLC0415  (half a second, which a mistyped folder need not wait for)

    page = optuna_dashboard.wsgi(_shown(folder))
    return make_server(host, port, _only_reading(page), server_class=_Server, handler_class=_Quiet)


def _shown(folder: Path) -> JournalStorage:
    """Return Optuna's storage of a study, which reads on when something is asked of it, and writes nothing."""
    from fin_optimizer.study.checked_journal import CheckedJournal, storage_of  # noqa: PLC0415  (Optuna is slow too)
    from fin_optimizer.study.folder import settings_and_sum  # noqa: PLC0415
    from fin_optimizer.study.records import read_trials  # noqa: PLC0415

    class ShownJournal(CheckedJournal):
        def append_logs(self, logs: list[dict[str, Any]]) -> None:  # noqa: ARG002  (none is taken)
            raise StudyError(_REFUSAL)

    read_trials(folder)  # a study that cannot be gone on with is told here, with what to do
    return storage_of(JournalLines(folder / JOURNAL_FILE, settings_and_sum(folder)[1]), ShownJournal)


def _only_reading(page: Any) -> Application:
    """Return a page that answers each request which would change something with a refusal."""

    def answer(request: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        if request["REQUEST_METHOD"] in _READING:
            answered: Iterable[bytes] = page(request, start)
            return answered
        start("403 Forbidden", [("Content-Type", "application/json")])
        return [json.dumps({"reason": _REFUSAL}).encode()]

    return answer


class _Server(ThreadingMixIn, WSGIServer):
    """A server that answers several requests at once, as a browser makes them."""

    daemon_threads = True


class _Quiet(WSGIRequestHandler):
    """Says nothing of each request."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002  (so named where it comes from)
        pass


if __name__ == "__main__":
    sys.exit(main())
