"""Command ``report``: a study, a campaign or several studies side by side as one HTML file to read and to print."""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fin_optimizer.study.file_names import JOURNAL_FILE, SETTINGS_FILE
from fin_optimizer.study.folder import bags_in, read_settings
from fin_optimizer.study.provenance import provenance
from fin_optimizer.study.records import read_ledger
from fin_plant import json_file
from fin_plant.command import command
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.report.parts import Page
    from fin_optimizer.report.study_facts import StudyFacts
    from fin_optimizer.study.candidate import TrialRecord

REPORT_FILE, COMPARISON_FILE = "report.html", "comparison.html"


def study_facts(folder: Path, *, beside: Path, simulated: bool = True, fish_file: Path | None = None) -> StudyFacts:
    """Return what a study's folder tells; nothing of the study is changed, the simulator's speeds are kept in it.

    Args:
        folder: Of the study; an optimiser may be working on it.
        beside: Folder of the page, from which its links lead.
        simulated: Whether the simulator swims too.
        fish_file: What `calibrate` wrote of the robot that swam.

    Raises:
        StudyError: There is no study, or this version cannot read it.
        ValueError: The fitted fish cannot be read, or did not swim.
    """
    # A second, which only who wants a report spends.
    from fin_optimizer.calibration.fish_file import read_fish  # noqa: PLC0415
    from fin_optimizer.report.simulated import CACHE_FILE  # noqa: PLC0415
    from fin_optimizer.report.study_facts import StudyFacts, simulate  # noqa: PLC0415

    notes: list[str] = []
    settings, (trials, fish) = read_settings(folder), read_ledger(folder, notes.append)
    there = {f"bags/{name}" for _, name in bags_in(folder)}
    versions, whose = _versions(folder, trials, there)
    fitted = None
    if fish_file is not None:
        try:
            fitted = (f"the fish of {fish_file.name}", read_fish(fish_file).fish)
        except OSError as error:
            msg = f"the fish cannot be read: {error}"
            raise ValueError(msg) from error
    said = simulate(settings, trials, fish, folder / CACHE_FILE, provenance(), fitted) if simulated else None
    away = os.path.relpath(folder, beside)
    linked = [replace(trial, bag=str(Path(away) / trial.bag)) for trial in trials]
    bags = frozenset(str(Path(away) / bag) for bag in there)
    return StudyFacts(folder.resolve().name, settings, linked, fish, versions, whose, bags, said, notes)


def _versions(folder: Path, trials: Sequence[TrialRecord], there: set[str]) -> tuple[Mapping[str, str], str]:
    """Return the versions that a study's first readable bag tells, or this program's own, and whose they are."""
    from fin_optimizer.bags.messages import BagError  # noqa: PLC0415  (bags need rosbags, a third of a second)
    from fin_optimizer.bags.reader import bag_metadata  # noqa: PLC0415

    for trial in trials[:5]:
        if trial.bag not in there:
            continue
        try:
            metadata = bag_metadata(folder / trial.bag)
        except (BagError, OSError):
            continue
        found = {name: value for name, value in metadata.items() if name.startswith(("version.", "git."))}
        if found:
            return found, f"those that swam trial {trial.number:04d}, as its bag has them"
    return provenance(), "those of the program that wrote this page: no bag tells others"


def _page(folders: Sequence[Path], target: Path, fish_file: Path | None) -> Page:
    """Return the page of what was given.

    Raises:
        StudyError: There is no study, or this version cannot read it.
        ValueError: A campaign or a fish that cannot be read, or a fish for what is no robot's study.
    """
    if fish_file is not None and (len(folders) > 1 or (folders[0] / "runs").is_dir()):
        msg = "--fish is for the report of one study, that of a robot"
        raise ValueError(msg)
    if len(folders) > 1:
        from fin_optimizer.report.comparison_page import comparison_page  # noqa: PLC0415

        return comparison_page([study_facts(folder, beside=target.parent, simulated=False) for folder in folders])
    (folder,) = folders
    if (folder / "runs").is_dir() and not (folder / JOURNAL_FILE).exists():
        return _campaign_page(folder)
    from fin_optimizer.report.study_page import study_page  # noqa: PLC0415

    return study_page(study_facts(folder, beside=target.parent, fish_file=fish_file))


def _campaign_page(folder: Path) -> Page:
    """Return the page of a campaign.

    Raises:
        ValueError: A campaign that cannot be read.
    """
    from fin_optimizer.paper.campaign import finished  # noqa: PLC0415
    from fin_optimizer.paper.experiments import Campaign, planned_runs  # noqa: PLC0415
    from fin_optimizer.paper.space_campaign import SpaceCampaign  # noqa: PLC0415
    from fin_optimizer.report.campaign_page import campaign_page  # noqa: PLC0415
    from fin_optimizer.report.space_campaign_page import space_campaign_page  # noqa: PLC0415

    name = folder.resolve().name
    try:
        content: Any = json_file.read(folder / SETTINGS_FILE)
        kind = SpaceCampaign if "space" in content else Campaign
        known = {each.name for each in fields(kind)}  # an older one lacks some, which it had by default
        given = {each: _tuples(content[each]) for each in content.keys() & known}
        if "space" in given:
            given["space"] = json.dumps(content["space"])
            given["fish"] = next(iter(content["fish"]))  # by its name
        campaign = kind(**given)
    except (AttributeError, OSError, LookupError, TypeError, ValueError) as error:
        msg = f"{folder} holds runs of a campaign, but its {SETTINGS_FILE} cannot be read ({error})"
        raise ValueError(msg) from error
    if isinstance(campaign, SpaceCampaign):
        return space_campaign_page(name, campaign, finished(folder, campaign.planned()), provenance())
    return campaign_page(name, campaign, finished(folder, planned_runs(campaign)), provenance())


def _tuples(value: Any) -> Any:
    """Return what JSON has as lists as tuples, which settings are."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def write_report(folders: Sequence[Path], output: Path | None = None, fish_file: Path | None = None) -> Path:
    """Write a report; return where. An older one is replaced as a whole or not at all.

    Args:
        folders: Of one study or campaign, or of several studies to be compared.
        output: The file, or a folder for it; the study's folder if left out, for several the current one.
        fish_file: What `calibrate` wrote of the robot that swam a study.

    Raises:
        StudyError: There is no study, or this version cannot read it.
        ValueError: A campaign or a fish that cannot be read, or a fish for what is no robot's study.
        OSError: The page cannot be written.
    """
    from fin_optimizer.report.page import html_of  # noqa: PLC0415

    name = REPORT_FILE if len(folders) == 1 else COMPARISON_FILE
    target = output or (folders[0] if len(folders) == 1 else Path())
    target = target / name if target.is_dir() else target
    if target.exists() and not target.is_file():
        msg = f"{target} is no file that a page could replace: give a file's name, or a folder"
        raise ValueError(msg)
    page = _page(folders, target, fish_file)
    foot = f"Written {datetime.now().astimezone():%Y-%m-%d %H:%M %Z} by `report` of fin_optimizer."
    text = html_of(replace(page, foot=foot))
    partial = target.with_name(target.name + ".partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
    return target


@command("report")
def main(arguments: Sequence[str] | None = None) -> int:
    """Write a report; return 0, or 2 if it cannot be."""
    parser = argparse.ArgumentParser(
        prog="report",
        description=f"Write a study as {REPORT_FILE}: one file for any browser, with all that it needs inside.",
    )
    parser.add_argument(
        "study",
        type=given_path,
        nargs="+",
        metavar="STUDY",
        help="folder of a study, which may be under way, or of a campaign; several studies are compared",
    )
    parser.add_argument(
        "--output",
        type=given_path,
        metavar="PATH",
        help=f"file or folder of the page; the study's folder if left out, of several the current one, as "
        f"{COMPARISON_FILE}",
    )
    parser.add_argument(
        "--fish",
        type=given_path,
        metavar="FILE",
        help="what calibrate wrote of the robot that swam the study: which the simulator swims then",
    )
    given = parser.parse_args(arguments)
    target = write_report(given.study, given.output, given.fish)
    sys.stdout.write(f"report: {target}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
