"""What stands for the simulator's code: whoever keeps what it computed sees by it that other code computed that."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import fin_plant
import fin_sim


@cache
def simulator_digest() -> str:
    """Return a digest of the code and the tables by which a fish swims, fin and gait among them."""
    digest = hashlib.sha256()
    for package in (fin_plant, fin_sim):
        folder = Path(package.__path__[0])
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.yaml")]):
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
