"""The block `execution` of a study file: where the work runs, never what it computes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Self

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.faults import Fault, Invalid, did_you_mean, one_of
from heliosweep.config.values import Choice, Quantity, Text, free_text, pattern
from heliosweep.errors import Problem, StudyError

__all__ = ["QUEUES", "Execution", "Job", "Profile"]

_LOCAL = {
    "threads": "threads of this process",
    "processes": "worker processes",
    "synchronous": "one by one",
    "distributed": "worker processes that are replaced when they die, with a dashboard",
}
QUEUES = {
    "slurm": "jobs of Slurm",
    "pbs": "jobs of PBS",
    "sge": "jobs of Grid Engine",
    "lsf": "jobs of LSF",
    "htcondor": "jobs of HTCondor",
    "oar": "jobs of OAR",
    "local-jobs": "jobs that are shell scripts of this machine, to try the set-up with",
}
"""Job queues by name, and what each means."""

_HOST = r"(?:[A-Za-z0-9](?:[A-Za-z0-9._-]{0,252})|\[[0-9A-Fa-f:.]{2,45}\])"
_ADDRESS = re.compile(rf"(?:tcp|tls)://{_HOST}:([0-9]{{1,5}})")
_WALLTIME = re.compile(r"(?:[0-9]{1,3}-)?[0-9]{1,4}:[0-5][0-9](?::[0-5][0-9])?")


@dataclass(frozen=True)
class Scheduler(Choice):
    """One of several names, or the address of a dask scheduler."""

    @property
    def purpose(self) -> str:
        """The description and what each name means."""
        return f"{super().purpose[:-1]}; tcp://HOST:PORT or tls://HOST:PORT: a dask scheduler that runs there)"

    def _one_schema(self) -> dict[str, Any]:
        return {"anyOf": [super()._one_schema(), pattern(_ADDRESS.pattern)]}

    def _one(self, raw: Any) -> str:
        if not isinstance(raw, str) or raw in self.options:
            return super()._one(raw)
        if "://" not in raw:
            known = f"use {one_of([*self.options, 'tcp://HOST:PORT'])}"
            raise Invalid(f"unknown choice{did_you_mean(raw, self.options) or f'; {known}'}")
        protocol = raw.partition("://")[0]
        if protocol not in ("tcp", "tls"):
            raise Invalid("must start with tcp:// or tls://, the protocols of a dask scheduler")
        found = _ADDRESS.fullmatch(raw)
        if not found or not 1 <= int(found.group(1)) <= 65535:
            raise Invalid(f"must be {protocol}://HOST:PORT, PORT between 1 and 65535")
        return raw


def _line(raw: Any) -> str:
    """Return one line of a job script. Raises Invalid."""
    if not all(letter.isprintable() or letter == "\t" for letter in free_text(raw)):
        raise Invalid("must be one line of printable text")
    return raw


def _walltime(raw: Any) -> str:
    """Return the longest time of a job as given. Raises Invalid."""
    if not isinstance(raw, str) or not _WALLTIME.fullmatch(raw):
        raise Invalid('must be a time such as "02:30:00" (hours, minutes, seconds), or "1-12:00:00" with days')
    return raw


_Line = partial(Text, form=_line)


class Job(Block):
    """One job of a job queue; as many are submitted as hold the workers."""

    queue: Annotated[str | None, _Line("Queue or partition")] = None
    account: Annotated[str | None, _Line("Account or project that is charged")] = None
    walltime: Annotated[
        str | None, Text("Longest time of a job", form=_walltime, schema=pattern(_WALLTIME.pattern))
    ] = None
    cores: Annotated[
        int, Quantity("Cores of a job, one worker each", "1", ge=1, le=4096, integer=True, sweep=False)
    ] = 1
    memory: Annotated[
        int, Quantity("Memory of a job", "B", ge=2**28, le=2**50, integer=True, sweep=False)
    ] = 2 * 2**30  # fmt: skip
    directives: Annotated[
        tuple[Annotated[str, _Line("Directive, without the queue's mark such as #SBATCH")], ...],
        Field(description="More directives of the job queue, each as after its mark such as #SBATCH"),
    ] = ()
    setup: Annotated[
        tuple[Annotated[str, _Line("Line of shell")], ...],
        Field(description="Lines of shell that run in each job before its workers, as to activate an environment"),
    ] = ()
    interface: Annotated[
        str | None, _Line("Network interface of scheduler and workers, such as ib0; by default this host's first")
    ] = None
    python: Annotated[str | None, _Line("Python in which heliosweep is installed; by default the one that submits")] = (
        None
    )


_SCHEDULER = Scheduler("Where the work runs", _LOCAL | QUEUES, sweep=False)
_CHUNKS = Field(description="Sizes of chunks along named dimensions; by default chosen by the plan")
_Chunks = dict[str, Annotated[int, Quantity("Size of a chunk", "1", ge=1, integer=True, sweep=False)]]


class Profile(Block):
    """Keys of the block `execution` for one machine."""

    scheduler: Annotated[str | None, _SCHEDULER] = None
    workers: Annotated[
        int | None, Quantity("Number of workers; by default all cores", "1", ge=1, le=65536, integer=True, sweep=False)
    ] = None
    memory: Annotated[
        int | None,
        Quantity("Memory the run may use; by default part of what is free", "B", gt=0, integer=True, sweep=False),
    ] = None
    chunks: Annotated[_Chunks | None, _CHUNKS] = None
    job: Annotated[Job | None, Field(description="What each job asks the job queue for; job queues only")] = None


class Execution(Profile):
    """Engine and machine of a run; no number of the result depends on them."""

    scheduler: Annotated[str, _SCHEDULER] = "threads"
    chunks: Annotated[_Chunks, _CHUNKS] = Field(default_factory=dict)
    profile: Annotated[str | None, Text("Which of the profiles is used")] = None
    profiles: Annotated[
        dict[str, Profile],
        Field(description="Named sets of keys of this block, one for each machine; they replace those of the block"),
    ] = Field(default_factory=dict)

    def rules(self) -> Iterable[Fault]:
        """Check that the profile is known, and that jobs are described for job queues alone."""
        if self.profile is not None and self.profile not in self.profiles:
            yield Fault(self._unknown(self.profile), ("profile",))
        merged = {name: profile.scheduler or self.scheduler for name, profile in self.profiles.items()}
        if self.job is not None and not {self.scheduler, *merged.values()} & set(QUEUES):
            yield Fault(_NO_QUEUE, ("job",), show_value=False)
        for name, profile in self.profiles.items():
            if profile.job is not None and merged[name] not in QUEUES:
                yield Fault(_NO_QUEUE, ("profiles", name, "job"), show_value=False)

    def resolved(self, profile: str | None = None) -> Self:
        """Return the block with the keys of a profile in place of its own.

        Parameters
        ----------
        profile : str, optional
            Name of the profile; by default the one that the block names, if any.

        Returns
        -------
        Execution
            Without profiles: resolving it again changes nothing.

        Raises
        ------
        StudyError
            Where the profile is unknown.
        """
        name = self.profile if profile is None else profile
        asked: dict[str, Any] = {"profile": None, "profiles": {}}
        if name is not None:
            if name not in self.profiles:
                raise StudyError(Problem(f"{self._unknown(name)} (got {name!r})", "execution.profile"))
            given = self.profiles[name]
            asked |= {key: value for key in Profile.model_fields if (value := getattr(given, key)) is not None}
        return self.model_copy(update=asked)

    def _unknown(self, name: str) -> str:
        known = f"the profiles are {', '.join(self.profiles)}" if self.profiles else "the study has no profiles"
        return f"unknown profile{did_you_mean(name, self.profiles) or f'; {known}'}"


_NO_QUEUE = f"describes jobs, and the scheduler is no job queue; those are {', '.join(QUEUES)}"
