"""Processes that begin a study in one folder at the same moment, each with a seed of its own, again and again."""

from __future__ import annotations

import multiprocessing
from typing import TYPE_CHECKING

from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import Settings

if TYPE_CHECKING:
    from multiprocessing.queues import Queue
    from multiprocessing.synchronize import Barrier
    from pathlib import Path

SPACE = Space((Dimension("fin.young_modulus", 0.5e9, 4e9, "Pa"),))
_PATIENCE = 60.0


def begin(seed: int, folders: list[Path], barrier: Barrier, told: Queue[list[str]]) -> None:
    """Begin a study in each folder, at the same moment as the others; tell what came of it, empty for a study."""
    words = []
    for folder in folders:
        barrier.wait(_PATIENCE)
        study = None
        try:
            study = Study.create(folder, Settings(SPACE, details={"seed": seed}))
            words.append("")
        except (StudyError, OSError) as error:
            words.append(f"{type(error).__name__}: {error}")
        barrier.wait(_PATIENCE)  # the winner holds its study until all have tried
        if study is not None:
            study.close()
    told.put(words)


def begin_together(folders: list[Path], processes: int) -> list[tuple[str, ...]]:
    """Return for each folder what came of it in each process; process n has seed n."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(processes)
    queues = [context.Queue() for _ in range(processes)]
    workers = [
        context.Process(target=begin, args=(seed, folders, barrier, told), daemon=True)
        for seed, told in enumerate(queues)
    ]
    for worker in workers:
        worker.start()
    words = [told.get(timeout=2 * _PATIENCE) for told in queues]
    for worker in workers:
        worker.join(_PATIENCE)
    return list(zip(*words, strict=True))
