"""The block `execution`: schedulers, addresses, job queues and profiles."""

from __future__ import annotations

from pathlib import Path

import pytest

from heliosweep.config.load import load
from heliosweep.config.schema import json_schema
from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
from tests.config.conftest import LINES, REGISTRY

CLUSTER = """
execution:
  scheduler: distributed
  workers: 3
  chunks: {latitude: 2}
  cluster: {class: dask_jobqueue.SLURMCluster, queue: long, cores: 16, memory: 32 GB, walltime: "12:00:00"}
"""


@pytest.mark.parametrize(
    "name",
    [
        "distributed", "tcp://127.0.0.1:8786", "tls://node-1.cluster.example:65535", "tcp://[::1]:1",
        "tcp://my_host:80",
    ],
)  # fmt: skip
def test_schedulers(load_study, name):
    assert load_study(f"execution: {{scheduler: '{name}'}}").execution.scheduler == name


@pytest.mark.parametrize(
    ("execution", "message"),
    [
        ("scheduler: slrum", "execution.scheduler: unknown choice; use 'threads'"),
        ("scheduler: 5", "execution.scheduler: must be 'threads'"),
        ("scheduler: [threads]", "execution.scheduler: must be a single value; it cannot be swept"),
        ("scheduler: 'http://a:80'", "execution.scheduler: must be tcp://HOST:PORT or tls://HOST:PORT, PORT"),
        ("scheduler: 'ucx://a:80'", "execution.scheduler: must be tcp://HOST:PORT or tls://HOST:PORT, PORT"),
        ("scheduler: 'tcp://a'", "execution.scheduler: must be tcp://HOST:PORT or tls://HOST:PORT, PORT"),
        ("scheduler: 'tls://a:65536'", "execution.scheduler: must be tcp://HOST:PORT or tls://HOST:PORT, PORT"),
        ("scheduler: 'tcp://a:0'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: 'tcp://:80'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: 'tcp://a b:80'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: \"tcp://a:80\\n\"", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: 'tcp://a:٣'", "execution.scheduler: must be tcp://HOST:PORT"),
        ("scheduler: slurm", "execution.scheduler: unknown choice; write 'scheduler: distributed' and"),
        ("cluster: {class: dask_jobqueue.SLURMCluster}", "execution.cluster: is for scheduler: distributed"),
        ("{scheduler: distributed, cluster: {cores: 3}}", "execution.cluster: must name a class"),
        ("{scheduler: distributed, cluster: 5}", "execution.cluster: "),
    ],
)  # fmt: skip
def test_messages(refused, execution, message):
    (problem,) = refused(f"execution: {execution if execution.startswith('{') else f'{{{execution}}}'}")
    place, _, said = str(problem).partition(": ")
    assert place.startswith("study.yaml:8:")
    assert said.startswith(message)


def test_no_part_of_the_identity(load_study):
    assert load_study(CLUSTER).study_id == load_study("").study_id


def test_written_and_read_again(load_study, tmp_path):
    study = load_study(CLUSTER)
    Path(tmp_path, "again.yaml").write_text(study.to_yaml())
    assert load(tmp_path / "again.yaml", REGISTRY).execution == study.execution


def test_schema(study_file):
    jsonschema = pytest.importorskip("jsonschema")
    import yaml

    validator = jsonschema.Draft202012Validator(json_schema(FieldEfficiencyStudy))
    good = yaml.safe_load("\n".join(LINES.values()) + CLUSTER)
    assert not list(validator.iter_errors(good))
    for execution in ({"scheduler": "tcp://a:80"}, {"scheduler": "distributed", "cluster": {"class": "a.B"}}):
        assert not list(validator.iter_errors(good | {"execution": execution}))
    for execution in ({"scheduler": "tcp://a"}, {"scheduler": "x"}, {"scheduler": "oar", "job": {"cores": 0}}):
        assert list(validator.iter_errors(good | {"execution": execution}))
