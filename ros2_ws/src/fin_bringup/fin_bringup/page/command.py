"""Command ``page``: a study and its fish on a phone at the tank, with buttons to confirm, start, pause and stop."""

from __future__ import annotations

import argparse
import asyncio
import os
import secrets
import signal
import socket
import sys
from typing import TYPE_CHECKING

from fin_bringup.page.access import Access, is_here
from fin_bringup.study_arguments import NAMESPACE
from fin_optimizer.parameters import NAMESPACE_PATTERN
from fin_plant import checks
from fin_plant.command import EXIT_FAILURE, EXIT_USAGE, tell_error
from fin_plant.output import go_on_when_output_closes

if TYPE_CHECKING:
    from collections.abc import Sequence

PORT = 8088
_HIGHEST_PORT = 65535
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_NO_SAFETY = "The page is no safety device: the switch of the servos' supply is."


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve the page until Ctrl-C; return 2 if the port cannot be used."""
    parser = argparse.ArgumentParser(
        prog="page",
        description="Show a study and its fish on a page for the phone at the tank: what the operator must do now, "
        "with buttons to confirm, start, pause and repeat, and an emergency stop. At this computer only; with --host "
        f"0.0.0.0 on the network, for whoever has the address with its token. {_NO_SAFETY}",
    )
    parser.add_argument("--namespace", default=NAMESPACE, help="of fish and optimiser (default: %(default)s)")
    parser.add_argument("--host", default="localhost", help="address to listen at (default: %(default)s)")
    parser.add_argument("--port", type=checks.read_whole_number, default=PORT, help="default: %(default)s")
    given = parser.parse_args(arguments)
    go_on_when_output_closes()
    try:
        checks.whole_number("--port", given.port, 0, _HIGHEST_PORT, advice="0 takes any that is free")
        _check_namespace(given.namespace)
        listening = _listening(given.host, given.port)
    except ValueError as error:
        tell_error("page", error)
        return EXIT_USAGE
    # Noted only: an exception out of a signal's handler is lost where it meets one of rclpy's callbacks.
    signals: list[int] = []
    for number in _SIGNALS:
        signal.signal(number, lambda came, _frame: signals.append(came))
    with listening:
        return asyncio.run(_serve(listening, given.host, given.namespace, signals))


def _check_namespace(namespace: str) -> None:
    if not NAMESPACE_PATTERN.fullmatch(namespace):
        msg = f"--namespace {namespace} must be like {NAMESPACE}: a slash, then letters, digits and _"
        raise ValueError(msg)


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens.

    Raises:
        ValueError: The address cannot be listened at.
    """
    from fin_bringup.page.server import listen  # noqa: PLC0415  (a fifth of a second, which who asks for help need not wait for)

    try:
        return listen(host, port)
    except OSError as error:
        why = os.strerror(error.errno) if error.errno is not None and error.errno > 0 else str(error)
        msg = f"cannot listen at {host}:{port}: {why}; give another --host or --port"
        raise ValueError(msg) from error


async def _serve(listening: socket.socket, host: str, namespace: str, signals: list[int]) -> int:
    import rclpy  # noqa: PLC0415
    from aiohttp import web  # noqa: PLC0415

    from fin_bringup.page.action_log import ActionLog  # noqa: PLC0415
    from fin_bringup.page.graph import GraphClient  # noqa: PLC0415
    from fin_bringup.page.server import Server  # noqa: PLC0415
    from fin_plant import node_process  # noqa: PLC0415

    loop, port = asyncio.get_running_loop(), listening.getsockname()[1]
    session, access = secrets.token_hex(4), Access.listening_at(host)
    log = ActionLog(lambda text: sys.stderr.write(f"warning: {text}\n"))
    server: Server | None = None
    ended = asyncio.Event()

    def end(number: int) -> None:
        signals.append(number)
        ended.set()

    def tell(told: dict[str, object]) -> None:
        if server is not None and not loop.is_closed():
            loop.call_soon_threadsafe(server.tell, told)

    with node_process.starting_ros():
        graph = GraphClient(namespace, session, log, tell, lambda: loop.call_soon_threadsafe(ended.set))
    try:
        server = Server(graph, access, session, port)
        runner = web.AppRunner(server.application(), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        graph.start()
        await web.SockSite(runner, listening).start()
        sys.stdout.write(_greeting(host, port, access.token))
        sys.stdout.flush()
        for number in _SIGNALS:
            loop.add_signal_handler(number, end, number)
        if not signals:
            await ended.wait()
        await runner.cleanup()
    finally:
        graph.close()
        log.close()
        rclpy.try_shutdown()
    return 128 + signals[0] if signals else EXIT_FAILURE


def _greeting(host: str, port: int, token: str) -> str:
    """Return where the page is."""
    if is_here(host):
        name = "localhost" if host == "127.0.0.1" else f"[{host}]" if ":" in host else host
        return f"page: http://{name}:{port} on this computer only, until Ctrl-C\n{_NO_SAFETY}\n"
    return (
        f"page: http://{_seen_as(host)}:{port}/?token={token} until Ctrl-C\n"
        f"Whoever has this address can confirm and start what moves the robot. {_NO_SAFETY}\n"
    )


def _seen_as(host: str) -> str:
    """Return the address at which others on the network find this computer."""
    if host not in {"0.0.0.0", "::"}:  # noqa: S104  (it is what was asked for)
        return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        try:
            way.connect(("192.0.2.1", 9))  # nothing is sent: it tells by which of its addresses this computer leaves
            return str(way.getsockname()[0])
        except OSError:
            return socket.gethostname()


if __name__ == "__main__":
    sys.exit(main())
