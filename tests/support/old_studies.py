"""Studies as versions before the check sums wrote them: what changes in them is not noticed by itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def take_off_check_sums(folder: Path) -> None:
    """Make a study one that has no check sums."""
    settings = json.loads((folder / "study.json").read_text())
    del settings["id"], settings["check_sum"]
    (folder / "study.json").write_text(json.dumps(settings, indent=2) + "\n")
    lines = [json.loads(line) for line in (folder / "journal.log").read_text().splitlines()]
    for line in lines:
        del line["check_sum"]
    (folder / "journal.log").write_text("".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines))
    (folder / "journal.end").unlink()
