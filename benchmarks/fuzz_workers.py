"""Worker processes that give readers spoilt files, with limits of time and memory, and what came of it.

The round's seed, the reader's name and a number identify a trial. A worker that ends, or is busy
with one file for too long, is ended and replaced; the file counts as a crash or a hang.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import random
import resource
import shutil
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from fuzz_mutations import mutated
from fuzz_samples import Reader, Sample
from photoclinometry.model.errors import InputError

SECONDS = 5.0
"""CPU time that one file may take."""
HANG_S = 30.0
"""A worker that is busy with one file for longer is ended [s]: other programs may have the processor meanwhile."""
BYTES = 2 << 30
"""Memory that a worker may have beyond what it has after its imports."""
BATCH = 100
"""Files for which a worker is asked at a time."""
_MIB = 1 << 20


@dataclass
class Tally:
    """Outcome of the spoilt files of one reader."""

    refused: int = 0
    accepted: int = 0
    slowest_s: float = 0.0
    largest_mib: float = 0.0
    """Growth of the worker's peak memory within a batch."""
    faults: list[tuple[int, str]] = field(default_factory=list)
    """(number of the trial, what was wrong)."""

    @property
    def files(self) -> int:
        return self.refused + self.accepted + len(self.faults)

    def add(self, other: Tally) -> None:
        """Counts another batch, too."""
        self.refused, self.accepted = self.refused + other.refused, self.accepted + other.accepted
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.largest_mib = max(self.largest_mib, other.largest_mib)
        self.faults += other.faults


@dataclass(frozen=True)
class Job:
    """A batch of trials of one reader."""

    name: str
    trials: range


def spoilt_files(name: str, good: list[Sample], trial: int, seed: int) -> Sample:
    """The input of a trial: one of the good inputs, with one of its files spoilt."""
    random_ = random.Random(f"{seed}/{name}/{trial}")
    sample = random_.choice(good)
    spoiled = random_.choice(sample.spoiled or tuple(sample.files))
    others = [s.files[f] for s in good for f in s.spoiled or tuple(s.files) if f != spoiled]
    return Sample(sample.entry, sample.files | {spoiled: mutated(sample.files[spoiled], others, random_)})


def write_files(sample: Sample, folder: Path) -> Path:
    """Writes an input into a folder; what the reader is given."""
    for name, content in sample.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder / sample.entry


def try_file(reader: Reader, path: Path) -> tuple[str, str, float]:
    """ "refused", "accepted" or "fault", what was wrong, and the CPU time [s] of reading one spoilt file."""
    begin = time.process_time()
    outcome, what = "accepted", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(path)
    except InputError as error:
        outcome = "refused"
        if isinstance(error.__cause__ or error.__context__, MemoryError):
            outcome, what = "fault", f"asked for more than {BYTES >> 30} GiB: {error.__cause__ or error.__context__}"
        elif str(path) not in str(error) and path.parent.name not in str(error):
            outcome, what = "fault", f"does not name the file: {error}"
    # Whatever else a reader raises is what is looked for.
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        outcome, what = "fault", "".join(traceback.format_exception(error, limit=-4))
    # The processes that readers start have limits of their own, and HANG_S stands above all.
    seconds = time.process_time() - begin
    if seconds > SECONDS and not what:
        outcome, what = "fault", f"took {seconds:.1f} CPU s"
    return outcome, what, seconds


def run_jobs(
    readers: dict[str, Reader], good: dict[str, list[Sample]], jobs: list[Job], seed: int, scratch: Path, workers: int
) -> dict[str, Tally]:
    """The tallies by reader of all jobs."""
    found = {name: Tally() for name in readers}
    waiting, busy = list(reversed(jobs)), []
    try:
        while waiting or busy:
            while waiting and len(busy) < workers:
                busy.append(_Worker(readers, good, seed, scratch / f"{len(waiting)}", waiting.pop()))
            multiprocessing.connection.wait([w.answers for w in busy], timeout=1.0)
            for worker in [*busy]:
                tally, rest = worker.look()
                found[worker.job.name].add(tally)
                if worker.done and waiting and worker.process.is_alive():
                    worker.take(waiting.pop())
                elif worker.done:
                    worker.end()
                    busy.remove(worker)
                    waiting += [rest] if rest else []
    finally:
        for worker in busy:
            worker.end()
    return found


class _Worker:
    """A process with one job at a time."""

    def __init__(self, readers: dict[str, Reader], good: dict[str, list[Sample]], seed: int, scratch: Path, job: Job):
        context = multiprocessing.get_context("fork")
        self.answers, theirs = context.Pipe()
        self.scratch = scratch
        self.trial = context.Value("q", -1)
        self.process = context.Process(target=_serve, args=(theirs, self.trial, readers, good, seed, scratch))
        self.process.start()
        theirs.close()
        self.take(job)

    def take(self, job: Job) -> None:
        """Begins with a job."""
        self.job, self.done, self.seen, self.since = job, False, -1, time.monotonic()
        self.answers.send(job)

    def look(self) -> tuple[Tally, Job | None]:
        """The findings since, and the rest of the job if the process crashed or hangs."""
        if self.answers.poll():
            try:
                tally = self.answers.recv()
            except (EOFError, OSError):
                return self._broken("crashed")
            self.done = True
            return tally, None
        if not self.process.is_alive():
            return self._broken("crashed")
        now, trial = time.monotonic(), self.trial.value
        if trial != self.seen:
            self.seen, self.since = trial, now
        if now - self.since > HANG_S:
            return self._broken(f"was busy for {HANG_S:g} s")
        return Tally(), None

    def _broken(self, what: str) -> tuple[Tally, Job | None]:
        self.process.join(timeout=1.0)
        at = max(self.trial.value, self.job.trials.start)
        self.done = True
        self.process.kill()
        self.process.join()
        rest = range(at + 1, self.job.trials.stop)
        # What was found before in this batch went with the process: those trials are made again.
        again = range(self.job.trials.start, at)
        tally = Tally(faults=[(at, f"{what} (exit code {self.process.exitcode})")])
        tally.refused += len(again)
        return tally, Job(self.job.name, rest) if rest else None

    def end(self) -> None:
        """Ends the process and removes its folder."""
        self.process.kill()
        self.process.join()
        self.answers.close()
        shutil.rmtree(self.scratch, ignore_errors=True)


def _serve(
    answers: Connection, trial: Any, readers: dict[str, Reader], good: dict[str, list[Sample]], seed: int, scratch: Path
) -> None:
    """Works until the connection ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # messages of C libraries about damaged files
    limit = _now_bytes("VmSize") + BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(EOFError):
        while True:
            job = answers.recv()
            tally, before = Tally(), _now_bytes("VmHWM")
            counted: Counter[str] = Counter()
            for number in job.trials:
                trial.value = number
                folder = scratch / f"{number}"
                path = write_files(spoilt_files(job.name, good[job.name], number, seed), folder)
                outcome, what, seconds = try_file(readers[job.name], path)
                counted[outcome] += 1
                tally.slowest_s = max(tally.slowest_s, seconds)
                if outcome == "fault":
                    tally.faults.append((number, what))
                shutil.rmtree(folder)
            tally.refused, tally.accepted = counted["refused"], counted["accepted"]
            tally.largest_mib = (_now_bytes("VmHWM") - before) / _MIB
            answers.send(tally)


def _now_bytes(key: str) -> int:
    """A figure of this process's memory, as Linux states it."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return 1024 * int(line.split()[1])
    raise ValueError(f"/proc/self/status has no {key}")
