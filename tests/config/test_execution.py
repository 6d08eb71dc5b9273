"""The block `execution`: schedulers, addresses, job queues and profiles."""

from __future__ import annotations

import pytest


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
        ("scheduler: [threads]", "execution.scheduler: must be a single value and cannot be swept"),
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
        ("{scheduler: distributed, cluster: {cores: 3}}", "execution.cluster: must have a class"),
        ("{scheduler: distributed, cluster: 5}", "execution.cluster: "),
    ],
)  # fmt: skip
def test_messages(refused, execution, message):
    (problem,) = refused(f"execution: {execution if execution.startswith('{') else f'{{{execution}}}'}")
    place, _, said = str(problem).partition(": ")
    assert place.startswith("study.yaml:8:")
    assert said.startswith(message)
