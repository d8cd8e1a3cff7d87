"""Graph tests start the real executables, each test in a ROS domain of its own."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING, Any, Protocol

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from fin_plant import topics
from support.domains import locked_domain
from support.processes import StartedProcess, start_executable, workspace_environment
from support.shared_memory import remove_stale_segments
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path


class Start(Protocol):
    """Starts an installed executable; ends with the test at the latest."""

    def __call__(
        self, package: str, executable: str, *arguments: str, environment: Mapping[str, str] | None = None
    ) -> StartedProcess:
        """Start it with these arguments, and with these variables besides the workspace's environment."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark everything in this folder as a graph test."""
    for item in items:
        if "/tests/graph/" in item.path.as_posix():
            item.add_marker(pytest.mark.graph)


@pytest.fixture(scope="session", autouse=True)
def clean_shared_memory() -> Iterator[None]:
    """Remove what killed nodes left in /dev/shm, from earlier runs and from this one."""
    remove_stale_segments()
    yield
    remove_stale_segments()


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS_DOMAIN_ID that nobody else uses, also set in this process' environment."""
    with locked_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
            if name in workspace_environment():  # not where the user's own settings hold
                monkeypatch.setenv(name, workspace_environment()[name])
        yield domain


@contextlib.contextmanager
def _starting(domain: int, path: Path) -> Iterator[Start]:
    """Yield what starts executables in this domain, their files in this folder; they are stopped, and must stop."""
    started: list[StartedProcess] = []
    logs = path / "logs"
    logs.mkdir()
    # Nodes log into the test's folder, not into the user's.
    base = workspace_environment() | {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(logs / "ros")}

    def start_one(
        package: str, executable: str, *arguments: str, environment: Mapping[str, str] | None = None
    ) -> StartedProcess:
        log = logs / f"{len(started) + 1}_{package}_{executable}.log"
        folder = path / "work"
        folder.mkdir(exist_ok=True)
        process = start_executable(
            package, executable, *arguments, log=log, environment=base | dict(environment or {}), folder=folder
        )
        started.append(process)
        return process

    yield start_one
    complaints = [complaint for process in reversed(started) for complaint in process.end()]
    for process in started:  # pytest shows it with a test that failed
        print(f"--- {process.name} (exit code {process.process.returncode}), {os.fspath(process.log)}:")  # noqa: T201
        print(process.tail())  # noqa: T201
    if complaints:
        pytest.fail("\n".join(complaints))


@pytest.fixture
def start(ros_domain: int, tmp_path: Path) -> Iterator[Start]:
    """Start executables by package and name; at the end of the test they are stopped, and must stop."""
    with _starting(ros_domain, tmp_path) as starting:
        yield starting


@pytest.fixture(scope="module")
def shared_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID that nobody else uses, for what the tests of a file share."""
    with locked_domain() as domain:
        yield domain


@pytest.fixture(scope="module")
def shared_start(shared_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Start]:
    """Start executables that all tests of a file share: a start takes as long as most tests."""
    with _starting(shared_domain, tmp_path_factory.mktemp("shared")) as starting:
        yield starting


@pytest.fixture
def call(ros_domain: int) -> Iterator[Callable[[str], Any]]:
    """Call a Trigger service by its name, relative to the fish's namespace, and wait for the answer."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = rclpy.create_node("caller", namespace=topics.NAMESPACE, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def call_one(name: str) -> Any:
        client = node.create_client(Trigger, name)
        wait_until(client.service_is_ready, 20, f"service {name}", lambda: executor.spin_once(timeout_sec=0.02))
        future = client.call_async(Trigger.Request())
        wait_until(future.done, 20, f"answer of {name}", lambda: executor.spin_once(timeout_sec=0.02))
        node.destroy_client(client)
        return future.result()

    yield call_one
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)
