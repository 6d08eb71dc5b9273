"""The block `execution` of a study file: engine and machine, which no number depends on."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, model_validator

from heliosweep.config.block import Block
from heliosweep.config.faults import Fault, Invalid
from heliosweep.config.values import Choice, Quantity

__all__ = ["Execution"]

log = logging.getLogger("heliosweep")

_LOCAL = {
    "threads": "threads of this process",
    "processes": "worker processes",
    "synchronous": "one by one",
    "distributed": "worker processes that are restarted when they die, with a dashboard, or the workers of `cluster`",
}
_DEVICES = {"cpu": "cores of the processor", "cuda": "an NVIDIA graphics processor, for rays; needs heliosweep[gpu]"}
#: Job queues of earlier versions, and their classes in dask_jobqueue.
QUEUES = {name: f"dask_jobqueue.{name.upper()}Cluster" for name in ("slurm", "pbs", "sge", "lsf", "oar")}
QUEUES["htcondor"] = "dask_jobqueue.HTCondorCluster"

_HOST = r"(?:[A-Za-z0-9](?:[A-Za-z0-9._-]{0,252})|\[[0-9A-Fa-f:.]{2,45}\])"
_ADDRESS = re.compile(rf"(?:tcp|tls)://{_HOST}:([0-9]{{1,5}})")


@dataclass(frozen=True)
class Scheduler(Choice):
    """One of several names, or the address of a dask scheduler."""

    def _one_schema(self) -> dict[str, Any]:
        return {"anyOf": [super()._one_schema(), {"type": "string", "pattern": f"^{_ADDRESS.pattern}$"}]}

    def _one(self, raw: Any) -> str:
        if isinstance(raw, str) and raw in QUEUES:
            raise Invalid(f"write scheduler: distributed and cluster: {{class: {QUEUES[raw]}, ...}} with its keywords")
        if not isinstance(raw, str) or "://" not in raw:
            return super()._one(raw)
        found = _ADDRESS.fullmatch(raw)
        if not found or not 1 <= int(found.group(1)) <= 65535:
            raise Invalid("must be tcp://HOST:PORT or tls://HOST:PORT, PORT between 1 and 65535")
        return raw


#: Keys of the block `job` of earlier versions with other names in dask_jobqueue.
_JOB = {"directives": "job_extra_directives", "setup": "job_script_prologue"}


class Execution(Block):
    """Engine and machine of a run; no number of the result depends on them."""

    scheduler: Annotated[
        str,
        Scheduler(
            "Engine of the run, or the address tcp://HOST:PORT or tls://HOST:PORT of a dask scheduler",
            _LOCAL,
            sweep=False,
        ),
    ] = "threads"
    workers: Annotated[
        int | None, Quantity("Number of workers; by default all cores", "1", ge=1, le=65536, integer=True, sweep=False)
    ] = None
    device: Annotated[str, Choice("Processor that traces rays", _DEVICES, sweep=False)] = "cpu"
    memory: Annotated[
        int | None,
        Quantity("Memory the run may use; by default a part of the free memory", "B", gt=0, integer=True, sweep=False),
    ] = None
    chunks: Annotated[
        dict[str, Annotated[int, Quantity("Size of a chunk", "1", ge=1, integer=True, sweep=False)]],
        Field(description="Sizes of chunks along named dimensions; by default chosen by the plan"),
    ] = Field(default_factory=dict)
    cluster: Annotated[
        dict[str, Any] | None,
        Field(description="Cluster of `scheduler: distributed`: `class`, such as dask_jobqueue.SLURMCluster, and its "
              "keywords; by default processes of this machine"),
    ] = None  # fmt: skip

    @model_validator(mode="before")
    @classmethod
    def _read_earlier_keys(cls, data: Any) -> Any:
        """Read profiles and jobs as earlier versions wrote them."""
        if not isinstance(data, dict) or not {"job", "profile", "profiles"} & data.keys():
            return data
        if not any(data.get(key) for key in ("job", "profile", "profiles")):
            return {key: value for key, value in data.items() if key not in ("job", "profile", "profiles")}
        log.warning(
            "execution: job, profile and profiles are deprecated; write scheduler: distributed and cluster: "
            "{class: dask_jobqueue.SLURMCluster, ...}, and keep the keys of each machine in a file for include"
        )
        profiles = data.get("profiles")
        profile = profiles.get(data.get("profile")) if isinstance(profiles, dict) else None
        keys = {**data, **(profile if isinstance(profile, dict) else {})}
        job, queue = keys.pop("job", None), keys.get("scheduler")
        keys.pop("profile", None)
        keys.pop("profiles", None)
        if queue in QUEUES:
            keywords = {_JOB.get(key, key): value for key, value in job.items()} if isinstance(job, dict) else {}
            keys |= {"scheduler": "distributed", "cluster": {"class": QUEUES[queue], **keywords}}
        return keys

    def rules(self) -> Iterable[Fault]:
        """Check that a cluster has a class, and a scheduler that uses it."""
        if self.cluster is not None and "." not in str(self.cluster.get("class", "")):
            yield Fault("must name a class, such as class: dask_jobqueue.SLURMCluster", ("cluster",))
        elif self.cluster is not None and self.scheduler != "distributed":
            yield Fault("is for scheduler: distributed", ("cluster",), show_value=False)
