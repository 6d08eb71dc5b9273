"""The block `execution`: schedulers, addresses, job queues and profiles."""

from __future__ import annotations

from pathlib import Path

import pytest

from heliosweep.config.blocks import Execution
from heliosweep.config.execution import QUEUES
from heliosweep.config.load import load
from heliosweep.config.study import json_schema
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
from tests.config.conftest import LINES, REGISTRY

PROFILES = """
execution:
  workers: 3
  chunks: {latitude: 2}
  profiles:
    laptop: {scheduler: distributed, memory: 2 GB}
    cluster:
      scheduler: slurm
      workers: 64
      chunks: {latitude: 1}
      job: {queue: long, account: a1, walltime: "12:00:00", cores: 16, memory: 32 GB, directives: [--exclusive],
            setup: [module load python, "source ~/venv/bin/activate"], python: python3}
"""


@pytest.mark.parametrize(
    "name",
    [
        "distributed", *QUEUES, "tcp://127.0.0.1:8786", "tls://node-1.cluster.example:65535", "tcp://[::1]:1",
        "tcp://my_host:80",
    ],
)  # fmt: skip
def test_schedulers(load_study, name):
    assert load_study(f"execution: {{scheduler: '{name}'}}").execution.scheduler == name


@pytest.mark.parametrize(
    ("execution", "message"),
    [
        ("scheduler: slrum", "execution.scheduler: unknown choice; did you mean 'slurm'? (got 'slrum')"),
        ("scheduler: 5", "execution.scheduler: must be 'threads'"),
        ("scheduler: [threads]", "execution.scheduler: must be a single value; it cannot be swept"),
        ("scheduler: 'http://a:80'", "execution.scheduler: must start with tcp:// or tls://"),
        ("scheduler: 'ucx://a:80'", "execution.scheduler: must start with tcp:// or tls://"),
        ("scheduler: 'tcp://a'", "execution.scheduler: must be tcp://HOST:PORT, PORT between 1 and 65535"),
        ("scheduler: 'tls://a:65536'", "execution.scheduler: must be tls://HOST:PORT"),
        ("scheduler: 'tcp://a:0'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: 'tcp://:80'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: 'tcp://a b:80'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: \"tcp://a:80\\n\"", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: 'tcp://a:٣'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("job: {queue: a}", "execution.job: describes jobs, and the scheduler is no job queue; those are slurm, pbs"),
        ("{scheduler: slurm, profiles: {a: {scheduler: threads, job: {}}}}", "execution.profiles.a.job: describes"),
        ("{scheduler: slurm, job: {qeue: a}}", "execution.job.qeue: unknown key; did you mean 'queue'?"),
        ("{scheduler: slurm, job: {cores: 0}}", "execution.job.cores: must be between 1 and 4096 (got 0)"),
        ("{scheduler: slurm, job: {memory: 1 kB}}", "execution.job.memory: must be between"),
        ("{scheduler: slurm, job: {walltime: 2 h}}", "execution.job.walltime: must be a time such as \"02:30:00\""),
        ("{scheduler: slurm, job: {walltime: 90}}", "execution.job.walltime: must be a time such as"),
        ("{scheduler: slurm, job: {queue: \"a\\nb\"}}", "execution.job.queue: must be one line of printable text"),
        ("{scheduler: slurm, job: {setup: module load x}}", "execution.job.setup: "),
        ("{scheduler: slurm, job: {setup: [x, 5]}}", "execution.job.setup[1]: must be text"),
        ("profile: a", "execution.profile: unknown profile; the study has no profiles (got 'a')"),
        ("{profile: labtop, profiles: {laptop: {}}}", "execution.profile: unknown profile; did you mean 'laptop'?"),
        ("{profile: x, profiles: {laptop: {}, big: {}}}", "execution.profile: unknown profile; the profiles are lap"),
        ("profiles: {a: {wokers: 3}}", "execution.profiles.a.wokers: unknown key; did you mean 'workers'?"),
        ("profiles: {a: {profile: b}}", "execution.profiles.a.profile: unknown key"),
        ("profiles: {a: {workers: 0}}", "execution.profiles.a.workers: must be between 1 and 65536 (got 0)"),
        ("profiles: {a: 5}", "execution.profiles.a: "),
        ("profiles: [a]", "execution.profiles: "),
    ],
)  # fmt: skip
def test_messages(refused, execution, message):
    (problem,) = refused(f"execution: {execution if execution.startswith('{') else f'{{{execution}}}'}")
    place, _, said = str(problem).partition(": ")
    assert place.startswith("study.yaml:8:")
    assert said.startswith(message)


def test_profiles(load_study):
    execution = load_study(PROFILES).execution
    assert execution.resolved() == Execution(workers=3, chunks={"latitude": 2})
    laptop = execution.resolved("laptop")
    assert laptop == Execution(scheduler="distributed", workers=3, memory=2 * 10**9, chunks={"latitude": 2})
    assert laptop.resolved() == laptop
    cluster = execution.resolved("cluster")
    assert (cluster.scheduler, cluster.workers, cluster.chunks) == ("slurm", 64, {"latitude": 1})
    assert cluster.job is not None
    assert cluster.job.setup == ("module load python", "source ~/venv/bin/activate")
    named = load_study(PROFILES + "  profile: laptop\n").execution
    assert named.resolved() == laptop
    assert named.resolved("cluster") == cluster
    with pytest.raises(StudyError, match="unknown profile; did you mean 'laptop'"):
        execution.resolved("lapptop")


def test_no_part_of_the_identity(load_study):
    assert load_study(PROFILES).study_id == load_study("").study_id


def test_written_and_read_again(load_study, tmp_path):
    study = load_study(PROFILES + "  profile: cluster\n")
    Path(tmp_path, "again.yaml").write_text(study.to_yaml())
    assert load(tmp_path / "again.yaml", REGISTRY).execution == study.execution


def test_schema(study_file):
    jsonschema = pytest.importorskip("jsonschema")
    import yaml

    validator = jsonschema.Draft202012Validator(json_schema(FieldEfficiencyStudy))
    good = yaml.safe_load("\n".join(LINES.values()) + PROFILES)
    assert not list(validator.iter_errors(good))
    for execution in ({"scheduler": "tcp://a:80"}, {"scheduler": "oar", "job": {"walltime": "1:00:00"}}):
        assert not list(validator.iter_errors(good | {"execution": execution}))
    for execution in ({"scheduler": "tcp://a"}, {"scheduler": "x"}, {"scheduler": "oar", "job": {"cores": 0}}):
        assert list(validator.iter_errors(good | {"execution": execution}))
