"""What the user's environment tells ROS 2, looked at before ROS 2 reads it.

The middleware ends the process without a word that helps, or passes over in silence, what it cannot use. Whatever it
can use is kept; where two settings contradict each other, or one has no effect here, a note names it.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn
from xml.etree import ElementTree as ET

from fin_plant.command import EXIT_USAGE, program, tell_error
from fin_plant.private_folder import private_folder

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, MutableMapping

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_PROFILES_IN_FOLDER = ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml")
"""Fast DDS reads them where a program is started."""
_REACH = frozenset(
    (
        RANGE,
        "ROS_STATIC_PEERS",
        "ROS_LOCALHOST_ONLY",
        "ROS_DISCOVERY_SERVER",
        "FASTDDS_DEFAULT_PROFILES_FILE",
        "FASTDDS_ENVIRONMENT_FILE",
    )
)
"""Variables by which a user says whom a node is to find."""
# Discovery within 0.2 s, and acknowledgements within milliseconds: with Fast DDS's own settings a reader acknowledges
# every three seconds, and a plant that waits for its listeners would stand still.
FAST_DDS_PROFILE = Path(__file__).with_name("fast_dds_profile.xml")
LOCALHOST_PROFILE = Path(__file__).with_name("fast_dds_localhost_profile.xml")
# A larger one has no UDP ports: 7400 + 250 a domain (DDSI-RTPS 2.5, 9.6.2.3).
_LAST_DOMAIN = 232
_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
# Set by a program for the nodes that it starts: they need not say the same again.
_NOTED = "FIN_ENVIRONMENT_NOTED"


def prepare() -> None:
    """Make this process' environment one that ROS 2 can start in, and say on stderr what contradicts in it.

    Raises:
        SystemExit: ROS 2 cannot start so; one line has said why and what to do.
    """
    try:
        check(os.environ)
        _choose_log_folder(os.environ)
    except ValueError as error:
        refuse(str(error))
    if not os.environ.get(_NOTED):
        for note in contradictions(os.environ):
            print(f"note: {note}", file=sys.stderr)  # noqa: T201
        os.environ[_NOTED] = "1"
    os.environ.update(discovery(os.environ, Path.cwd()))


def discovery(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Return the variables to set besides those given, for a program that is started in ``folder``: this machine only.

    A robot's graph takes commands from whoever is on it, so other computers are a decision of the person: whoever has
    named a reach (any of `_REACH`) gets the quick profile without a reach of its own; whoever has a profile or another
    middleware, nothing. Tools without any setting see the nodes on the same machine. `scripts/environment.sh` has the
    same rule for the command line.
    """
    given = {name for name, value in environment.items() if value}
    has_profile = PROFILES in given or any((folder / name).exists() for name in _PROFILES_IN_FOLDER)
    if has_profile or "fastrtps" not in (environment.get("RMW_IMPLEMENTATION") or "fastrtps"):
        return {}
    if given & _REACH:
        return {PROFILES: str(FAST_DDS_PROFILE)}
    # With the range LOCALHOST, ROS 2 would add the shared memory that the profile leaves out.
    return {PROFILES: str(LOCALHOST_PROFILE), RANGE: "SYSTEM_DEFAULT"}


def refuse(what: str) -> NoReturn:
    """End the process for what ROS 2 cannot start with.

    Raises:
        SystemExit: Always, with exit code 2.
    """
    tell_error(program(), " ".join(what.split()))
    raise SystemExit(EXIT_USAGE)


def check(environment: Mapping[str, str]) -> None:
    """Refuse settings with which the middleware would end the process, or would go on without them.

    Raises:
        ValueError: A setting that cannot be used; the message is one line with advice.
    """
    domain = environment.get("ROS_DOMAIN_ID", "").strip()
    if domain and not (domain.isascii() and domain.isdecimal() and int(domain) <= _LAST_DOMAIN):
        msg = f"ROS_DOMAIN_ID={domain} must be a whole number from 0 to {_LAST_DOMAIN}: change or unset it"
        raise ValueError(msg)
    discovery = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if discovery and discovery not in _RANGES:
        msg = f"ROS_AUTOMATIC_DISCOVERY_RANGE={discovery} must be one of {', '.join(_RANGES)}: change or unset it"
        raise ValueError(msg)
    middleware = environment.get("RMW_IMPLEMENTATION", "")
    folders = list(_library_folders(environment))
    if middleware and folders and not any((folder / f"lib{middleware}.so").exists() for folder in folders):
        msg = f"RMW_IMPLEMENTATION={middleware} is not installed here: unset it, or install that ROS package"
        raise ValueError(msg)
    if "fastrtps" in (middleware or "fastrtps"):
        _check_profiles(environment.get(PROFILES, ""))


def _library_folders(environment: Mapping[str, str]) -> Iterator[Path]:
    """Yield the folders that hold a middleware, none where they are not known."""
    libraries = environment.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    prefixes = (f"{prefix}/lib" for prefix in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix)
    for folder in (Path(name) for name in dict.fromkeys([*libraries, *prefixes]) if name):
        if any(folder.glob("librmw_*.so")):
            yield folder


def _check_profiles(name: str) -> None:
    if not name:
        return
    advice = "correct or unset it"
    try:
        root = ET.parse(name).getroot()  # noqa: S314  (the user's own file; Fast DDS reads it next)
    except OSError as error:
        msg = f"{PROFILES}={name} cannot be read ({error.strerror}): {advice}"
        raise ValueError(msg) from None
    except ET.ParseError as error:
        msg = f"{PROFILES}={name} is no XML ({error}), and Fast DDS would go on without it: {advice}"
        raise ValueError(msg) from None
    if root.tag.rpartition("}")[2] not in {"dds", "profiles"}:
        msg = f"{PROFILES}={name} has no profiles of Fast DDS, its root is <{root.tag.rpartition('}')[2]}>: {advice}"
        raise ValueError(msg)


def _choose_log_folder(environment: MutableMapping[str, str]) -> None:
    """Have ROS 2 log where it can: it does not start where it cannot.

    Raises:
        ValueError: The user's own choice cannot be written to, or no folder at all can.
    """
    chosen = next((name for name in ("ROS_LOG_DIR", "ROS_HOME") if environment.get(name)), None)
    try:
        folder = Path(environment[chosen] if chosen else "~/.ros").expanduser()
        if chosen != "ROS_LOG_DIR":
            folder /= "log"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            environment["ROS_LOG_DIR"] = str(folder)  # ROS itself asks for HOME, which may be unset
            return
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
        if chosen:
            why = getattr(error, "strerror", None) or error
            msg = f"{chosen}={environment[chosen]} cannot be written to ({why}): give it a folder that can, or unset it"
            raise ValueError(msg) from None
    try:
        environment["ROS_LOG_DIR"] = str(private_folder("fin-log"))
    except OSError as error:
        msg = f"nothing can be logged, neither to ~/.ros/log nor to a temporary folder ({error}): set ROS_LOG_DIR"
        raise ValueError(msg) from None


def contradictions(environment: Mapping[str, str]) -> list[str]:
    """Return a sentence for each setting that has no effect here, or another one than it seems."""
    given = {name: value for name, value in environment.items() if value}
    discovery = given.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    localhost = given.get(PROFILES) == str(LOCALHOST_PROFILE)
    subnet = f"{PROFILES}={FAST_DDS_PROFILE}"
    notes = []
    if "FASTDDS_DEFAULT_PROFILES_FILE" in given:
        notes.append(
            f"FASTDDS_DEFAULT_PROFILES_FILE is not read by the Fast DDS of ROS 2 Jazzy: call the variable {PROFILES}"
        )
    if given.get("ROS_LOCALHOST_ONLY") == "1":
        notes.append(
            "ROS_LOCALHOST_ONLY=1 brings shared memory in, where a killed process can stop all others: unset it"
            + (", everything stays on this computer anyway" if localhost else "")
        )
    if "ROS_STATIC_PEERS" in given and discovery in {"SYSTEM_DEFAULT", "OFF"}:
        notes.append(
            f"ROS_STATIC_PEERS has no effect with ROS_AUTOMATIC_DISCOVERY_RANGE={discovery}: "
            f"set that to SUBNET" + (f" and {subnet}" if localhost else "")
        )
    if "ROS_DISCOVERY_SERVER" in given:
        notes.append(
            f"ROS_DISCOVERY_SERVER={given['ROS_DISCOVERY_SERVER']} is kept: nodes find each other only by that server"
            + (f", which must run on this computer, or set {subnet}" if localhost else "")
        )
    if given.get("RMW_FASTRTPS_USE_QOS_FROM_XML") == "1":
        notes.append("RMW_FASTRTPS_USE_QOS_FROM_XML=1: the profile's QoS takes the place of the topics' own: unset it")
    middleware = given.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    if "fastrtps" not in middleware:
        notes.append(f"RMW_IMPLEMENTATION={middleware} is kept; only with rmw_fastrtps_cpp has all of this been tested")
    elif "CYCLONEDDS_URI" in given:
        notes.append("CYCLONEDDS_URI has no effect: the middleware is rmw_fastrtps_cpp")
    return notes
