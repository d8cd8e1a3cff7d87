"""Bags of older versions get what a 3-D view needs, in a copy with the same score."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.commands import enrich_bag
from fin_optimizer.score.recorded import score_bag
from fin_plant.frames import Frames
from support.bags import write_swim
from support.source_tree import SOURCE

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

OLD = SOURCE.parents[1] / "tests/data/study_2026_11/bags/trial_0000_E3.293GPa"


def test_an_old_bag_gets_frames_shapes_and_path_in_a_copy_with_its_score_at_less_than_half_again_its_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = shutil.copytree(OLD, tmp_path / "old")
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    assert enrich_bag.main([str(bag)]) == 0
    copy = tmp_path / "old_3d"
    assert capsys.readouterr().out == f"{copy}\n"
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before
    old, new = read_bag(bag), read_bag(copy)
    assert {name: new.counts[name] for name in old.counts} == old.counts
    assert score_bag(copy)[0] == score_bag(bag)[0]
    assert {"/tf", "/fish/markers", "/fish/path", "/fish/robot_description"} == new.topics.keys() - old.topics.keys()
    ((_, described),) = new.decoded("robot_description")
    frames = Frames.from_urdf(described.data)
    names = next(message.name for _, message in new.decoded("joint_states"))
    assert [joint.name for joint in frames.joints] == names
    poses = {stamp: message.pose.position for stamp, message in new.decoded("pose")}
    for stamp, message in new.decoded("/tf"):
        place = message.transforms[0].transform.translation
        assert (place.x, place.y) == (poses[stamp].x, poses[stamp].y)
    size = {folder: sum(path.stat().st_size for path in folder.iterdir()) for folder in (bag, copy)}
    assert size[copy] < 1.5 * size[bag]


def test_a_bag_without_pose_or_with_frames_is_refused_with_what_it_lacks_and_nothing_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_swim(tmp_path / "swim")
    assert enrich_bag.main([str(bag)]) == 2
    assert f"bag {bag} has no pose and no joint_states: nothing tells where the fish was" in capsys.readouterr().err
    assert enrich_bag.main([str(OLD), "--into", str(tmp_path / "new")]) == 0
    (copy,) = (tmp_path / "new").iterdir()
    assert enrich_bag.main([str(copy)]) == 2
    assert "holds /tf already" in capsys.readouterr().err
    assert enrich_bag.main([str(OLD), "--into", str(tmp_path / "new")]) == 2
    assert "exists already and is not overwritten" in capsys.readouterr().err
    assert not (tmp_path / "swim_3d").exists()
