"""Batches that come back whatever they do to the workers: the guilty case is found, tried again and set aside.

A case that raises is not tried again: it is a function of its identity alone, so it would raise again, and
`--retry-failed` is there for when the cause was mended.  A worker that dies or is ended may have been unlucky: its case
gets `ATTEMPTS` in all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from critflow.result import EnvironmentFailure
from critflow.workflow.attempts import Death, deaths
from critflow.workflow.batch import Job, Outcome, record_failure
from critflow.workflow.fanout import Batch, FanOut, Interruption
from critflow.workflow.plan import Selection

ATTEMPTS = 3


def supervised(
    compute: FanOut, job: Job, selection: Selection, batches: Sequence[Batch], interruption: Interruption
) -> Iterator[tuple[Batch, list[Outcome]]]:
    """Every batch, or the parts it was taken into, with its outcomes; those of cases set aside among them."""
    shards, groups = Path(job.shards), deque([list(batches)])
    fruitless = 0  # groups in a row that brought nothing, not even somebody to blame
    while groups:
        again: list[Batch] = []
        died = fruitful = False
        for batch, outcomes in compute(groups.popleft()):
            if outcomes is not None:
                fruitful = True
                yield batch, outcomes
                continue
            if interruption.asked:
                continue
            died = True
            ids = [selection.case(**values).id for values in batch]
            blamed = deaths(job.run, shards, ids)
            fruitful |= bool(blamed)
            if innocent := [values for values, case_id in zip(batch, ids, strict=True) if case_id not in blamed]:
                again.append(innocent)
            for values, case_id in zip(batch, ids, strict=True):
                tries = blamed.get(case_id, [])
                # Cases that ran in one process, as in workers with threads, are blamed together.
                alone = any(len(death.cases) == 1 for death in tries)
                if len(tries) >= ATTEMPTS and alone:
                    yield [values], [_set_aside(selection, shards, values, tries)]
                elif len(tries) >= ATTEMPTS - 1 and not alone:
                    groups.append([[values]])
                elif tries:
                    again.append([values])
        fruitless = fruitless + 1 if died and not fruitful else 0
        if fruitless == ATTEMPTS:
            raise EnvironmentFailure("the worker processes die before they begin a case: try fewer, or --workers 0")
        if again:
            groups.appendleft(again)


def _set_aside(selection: Selection, shards: Path, values: Mapping[str, int | str], tries: Sequence[Death]) -> Outcome:
    last = tries[-1]
    error = f"{last.stack}\nthe case {last.reason}, in {len(tries)} attempts"
    return record_failure(selection.study, shards, selection.case(**values), error)
