"""Whatever a study file holds, it can be planned or is refused where it is wrong, quickly and in little memory.

The same for tables and images that studies name.
"""

from __future__ import annotations

import itertools
import math
import os
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml

import heliosweep
from heliosweep import api
from heliosweep.config.source import MAX_BYTES, MAX_VALUES
from heliosweep.errors import StudyError
from tests.conftest import SMALL
from tests.faults.attempts import Attempts
from tests.faults.judge import TABLE, Pool, Verdict, complaints
from tests.faults.mutations import FLOOD_HEADS, FLOODS, corpus, flooded, hostile_folder, mutated
from tests.report.test_page import Page


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    # Beside other processes of tests one worker: each takes a dozen seconds to import and to warm up.
    pool = Pool(tmp_path_factory.mktemp("hostile"), 1 if "PYTEST_XDIST_WORKER" in os.environ else 2)
    yield pool
    pool.close()


def all_right(verdicts: Iterable[Verdict], attempts: Attempts | None = None) -> Counter[str]:
    """Count the outcomes, and note or fail where one is a defect."""
    verdicts, made = list(verdicts), attempts or Attempts(0, 1.0)
    for verdict in verdicts:
        with made.at(verdict.name):
            assert not verdict.defect, verdict.defect
    if len(verdicts) > 1:  # shown by pytest -rP
        slowest, largest = max(verdicts, key=lambda one: one.seconds), max(verdicts, key=lambda one: one.bytes)
        most = f"{slowest.seconds:.2f} s ({slowest.name}), {largest.bytes / 1e6:.0f} MB ({largest.name})"
        print(f"{Counter(verdict.outcome for verdict in verdicts)}, at most {most}")
    assert attempts or not made.failed, made.failed[:20]
    return Counter(verdict.outcome for verdict in verdicts)


@pytest.mark.attempts("studies", 10_000)
def test_mutated_files(pool, attempts):
    """Every twentieth of those that may be run quickly is run."""
    outcomes = all_right(pool.judge((str(seed), None, seed // 10 % 20 == 0) for seed in attempts.numbers), attempts)
    made = outcomes.total()
    assert outcomes["refused"] > made / 2
    assert outcomes["plan"] > made / 20  # or the mutations would only ever try the reader
    assert outcomes["ran"]


@pytest.mark.attempts("tables", 5_000)
def test_mutated_tables_and_images(pool, attempts):
    outcomes = all_right(pool.judge((f"{TABLE}{seed}", None, False) for seed in attempts.numbers), attempts)
    assert min(outcomes["refused"], outcomes["plan"]) > outcomes.total() / 20


@pytest.mark.long
def test_floods(pool):
    """Files of the largest size that is read, full of something small."""

    def tasks() -> Iterable[tuple[str, bytes, bool]]:
        for head, piece in itertools.product(FLOOD_HEADS, FLOODS):
            text = flooded("" if head.startswith("{") else corpus()[0], piece, head, MAX_BYTES - 5000)
            ends = "]" * head.count("[") + "}" * head.count("{")
            for end in {"", ends}:
                content = (text + end).encode()
                yield f"{head!r} {piece!r} {end!r}", content[:MAX_BYTES], False

    all_right(pool.judge(tasks()))


def test_some_floods(pool):
    pieces = ("[], ", "a: 1\n", "1, ", "{name: a, latitude: 91, timezone: x}, ", "? ")
    heads = ("x: " + "[" * 45, "sites: [", "")
    contents = (flooded(corpus()[0], piece, head, MAX_BYTES) for head, piece in itertools.product(heads, pieces))
    all_right(pool.judge((f"flood {number}", text.encode(), False) for number, text in enumerate(contents)))


def test_mutations_follow_from_the_seed():
    assert [mutated(seed) for seed in range(20)] == [mutated(seed) for seed in range(20)]
    assert len({mutated(seed) for seed in range(100)}) > 95


# The judge itself must be able to say no.


def test_the_judge_tells_time_memory_and_tracebacks(pool, tmp_path, monkeypatch):
    from tests.faults import judge

    path = tmp_path / "study.yaml"
    path.write_text("family: x")

    monkeypatch.setattr(judge, "SECONDS", 0.2)

    def verdict(load) -> str:
        monkeypatch.setattr(judge.api, "load", load)
        return judge.judge(path, "family: x", "one").defect

    def deep(_):
        return deep(_)

    def forever(_):
        while True:
            pass

    assert "Overtime" in verdict(forever)
    assert "MemoryError" in verdict(lambda _: bytearray(8 * judge.BYTES))
    assert "ZeroDivisionError" in verdict(lambda _: 1 / 0)
    assert "RecursionError" in verdict(deep)


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        ({"message": "is wrong", "file": "s.yaml", "line": 1, "column": 1}, ""),
        ({"message": "is wrong", "file": "s.yaml", "key": "a"}, "not located"),
        ({"message": "is wrong", "key": "a"}, "no file"),
        ({"message": "is wrong", "file": "s.yaml", "line": 9, "column": 1}, "outside"),
        ({"message": "is \x1b[31m", "file": "t.csv"}, "terminal"),
    ],
)
def test_the_judge_reads_the_problems(problem, said):
    from heliosweep.errors import Problem

    found = "\n".join(complaints([Problem(**problem)], "s.yaml", "family: x\n"))
    assert said in found
    assert bool(found) == bool(said)


# What was found, each by the smallest file that shows it.


def refusal(folder: Path, text: str | bytes) -> list[str]:
    """Return the messages with which a study file is refused, the name of its folder left out."""
    path = folder / "study.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(StudyError) as error:
        api.plan(api.load(path))
    return [str(problem).replace(f"{folder}/", "") for problem in error.value.problems]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            'title: "\\e[2J\\0"\n',
            "1:8: title: character U+001B is not allowed, also not as an escape; in double quotes a backslash starts "
            "an escape: write folders with '/'",
        ),
        ("a: 1\rb: \x07\r", "2:4: character U+0007 is not allowed"),
        ("a: !%0A%E2%80%AE x\n", "1:4: a: tags are not allowed (got !\\n\\u202e); write the plain value"),
        (
            "x: " + "[" * 45 + "1," * MAX_VALUES,
            f"1:{49 + 2 * (MAX_VALUES - 47)}: holds more than 50,000 keys and values; put long lists into a CSV table",
        ),
    ],
    ids=["escapes", "old line ends", "tags", "values"],
)
def test_one_problem(tmp_path, text, said):
    assert refusal(tmp_path, text) == [f"study.yaml:{said}"]


def test_long_keys_and_those_that_would_move_a_terminal(tmp_path):
    assert all(len(line) < 300 for line in refusal(tmp_path, "family: dish_tracking\n" + "k" * 900 + ": 1\n"))
    said = refusal(tmp_path, 'family: dish_tracking\n"a\\n\u202e": 1\n')
    assert any(line.startswith("study.yaml:2:1: a\\n\\u202e: unknown key") for line in said)


def test_many_duplicates_before_what_cannot_be_read(tmp_path):
    assert len(refusal(tmp_path, "a: 1\n" * 500 + "b: *c\n")) == 100


def test_tables_of_wrong_sites_are_cut(tmp_path):
    (tmp_path / "sites.csv").write_text("name,latitude\n" + "".join(f"n{number},91\n" for number in range(500)))
    text = yaml.safe_dump({**SMALL, "site": None, "sites": {"file": "sites.csv"}}).replace("site: null\n", "")
    assert len(refusal(tmp_path, text)) == 21


@pytest.mark.parametrize(
    "name", ["sparse.csv", "fifo", "/proc/self/mem", "/dev/zero", "../../../../dev/zero", "folder"]
)
@pytest.mark.parametrize(
    "block", ["sites: {file: FILE}", "layout: {file: FILE}", "report: {published: {file: FILE, source: x}}"]
)
def test_files_that_nobody_should_read(pool, name, block):
    key = block.partition(":")[0]
    others = {name: value for name, value in SMALL.items() if name != key and (key, name) != ("sites", "site")}
    verdict = pool.one((yaml.safe_dump(others) + block.replace("FILE", name) + "\n").encode())
    assert not verdict.defect
    assert verdict.outcome == "refused" or key == "report"  # read when the run begins


def test_chunks_of_no_dimension_are_located(tmp_path):
    said = refusal(tmp_path, yaml.safe_dump(SMALL) + "execution: {chunks: {nowhere: 3}}\n")
    assert len(said) == 1
    line = yaml.safe_dump(SMALL).count("\n") + 1
    assert said[0].startswith(f"study.yaml:{line}:31: execution.chunks.nowhere: unknown dimension")


@pytest.mark.parametrize("family", ["field_efficiency", "misalignment"])
def test_more_hours_than_memory_holds(pool, family):
    study = yaml.safe_load(next(text for text in corpus() if f"family: {family}" in text and "clock: solar" in text))
    study["time"] = {"clock": "solar", "days": [81], "hours": {"start": 8, "stop": 16, "num": 10**13}}
    assert not pool.one(yaml.safe_dump(study).encode()).defect


def test_more_steps_of_a_clear_day_than_memory_holds(pool):
    study = yaml.safe_load(next(text for text in corpus() if "clear_sky:" in text))
    study["time"]["window"]["step"] = 1e-12
    verdict = pool.one(yaml.safe_dump(study).encode())
    assert not verdict.defect
    assert verdict.outcome == "refused"


def test_a_tab_behind_a_quoted_text(tmp_path):
    (tmp_path / "field.csv").write_text('x\ty\n"1"2\t3\n')
    said = refusal(tmp_path, yaml.safe_dump({**SMALL, "layout": {"file": "field.csv"}}))
    assert said == ["field.csv:2: is not CSV: '\\t' expected after '\"'"]


def test_a_study_named_with_a_backslash(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a\\b.yaml").write_text(yaml.safe_dump(SMALL))
    study = api.load("a\\b.yaml")
    assert api.result_folder(study).name == f"a_b-{study.study_id}"


def test_cameras_far_apart(tmp_path):
    study = yaml.safe_load(next(text for text in corpus() if text.count("arrangement: square")))
    study["cameras"] = {"positions": [[1e200, 0], [0, 1e200], [0, -1e200], [-1e200, 0]]}
    hostile_folder(tmp_path / "tables")
    path = tmp_path / "tables/study.yaml"
    path.write_text(yaml.safe_dump(study))
    assert api.load(path).family == "backward_gazing"  # warnings are errors here


# Names that lead elsewhere.


@pytest.mark.parametrize("name", ["../../x", "..", "<b>x</b>", "/x"])
def test_names_cannot_lead_out_of_the_result_folder(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sites = [{"name": name, "latitude": 0}, {"name": "b", "latitude": 40}]
    study = {**{key: value for key, value in SMALL.items() if key != "site"}, "sites": sites, "title": name}
    folder = tmp_path / "in/study"
    path = folder / f"{name.replace('/', '_')}.yaml"
    folder.mkdir(parents=True)
    path.write_text(yaml.safe_dump(study))
    before = {path, *path.parents}
    result = api.run(api.load(path))
    assert result.folder.resolve().parent == tmp_path / "outputs"
    written = {place for place in tmp_path.rglob("*") if place.is_file()} - before
    assert result.path.resolve() in written
    index = tmp_path / "outputs/index.html"
    assert all(place.is_relative_to(result.folder.resolve()) for place in written - {index})
    for page in (result.folder / "report.html", index):
        assert "<b>x" not in page.read_text(encoding="utf-8")


EVIL = "<script>alert('&')</script>"


@pytest.mark.parametrize(
    "evil", [EVIL, "$\\frac{$ \\x {0} %s", "\u202e\u0627\u2066"], ids=["markup", "formula", "bidi"]
)
def test_words_and_names_of_a_study_on_its_page(tmp_path, monkeypatch, evil):
    monkeypatch.chdir(tmp_path)
    file = evil.replace("/", "_")
    rows = [f"{radius * math.sin(angle)},{radius * math.cos(angle)}" for radius in (60, 80) for angle in range(6)]
    for name in (f"{file}.csv", "b.csv"):
        (tmp_path / name).write_text("\n".join(["x,y,note", *(f'{row},"{evil}"' for row in rows)]), encoding="utf-8")
    study = {
        **{key: value for key, value in SMALL.items() if key != "site"},
        "title": evil,
        "description": f"{evil} {evil}",
        "references": [evil, f"doi:10.1/{evil}"],
        "sites": [{"name": evil, "latitude": 0}, {"name": f"{evil}2", "latitude": 40}],
        "layout": {"file": [f"{file}.csv", "b.csv"]},
    }
    path = tmp_path / f"{file}.yaml"
    path.write_text(yaml.safe_dump(study, allow_unicode=True), encoding="utf-8")
    result = api.run(api.load(path))
    text = (result.folder / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert "<script>alert" not in text
    assert page.all("script") == [{"type": "application/json", "id": "heliosweep-plots"}, {}, {}, {}]  # our own
    assert page.text.count(evil) > 3
    assert not [value for _, attrs in page.elements for key, value in attrs.items() if key.startswith("on")]


# No pickle.

#: What could unpickle or run code that it reads, and numpy.load without a word on pickles.
PICKLES = re.compile(
    r"(import|from) (c?pickle|_pickle|cloudpickle|dill|joblib|shelve|marshal)\b|read_pickle|allow_pickle=(?!False)|"
    r"(full|unsafe)_load|yaml\.C?(Unsafe|Full)?Loader|\b(np|numpy)\.load\((?!.*allow_pickle=False)"
)
#: Modules that pickle between processes of one run, in memory; and numba's cache of the machine code of our kernels,
#: which nobody else must be able to write to.
KNOWN = {"runs/executors.py", "runs/cluster.py", "kernels/machine_code.py"}


def pickles(text: str) -> list[str]:
    """Lines of code that could unpickle."""
    return [line for line in text.splitlines() if PICKLES.search(line)]


def test_no_pickle_is_read_from_disk():
    package = Path(heliosweep.__file__).parent
    sources = {path.relative_to(package).as_posix(): path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    assert len(sources) > 100
    assert {name for name, text in sources.items() if pickles(text)} == KNOWN
    for name in KNOWN - {"kernels/machine_code.py"}:
        assert not re.search(r"pickle\.load\(|\bopen\(|read_bytes", sources[name]), name


@pytest.mark.parametrize(
    "code",
    [
        "import pickle", "from pickle import loads", "import joblib", "import shelve", "np.load(p)",
        "np.load(p, allow_pickle=True)", "pd.read_pickle(p)", "yaml.load(p, yaml.UnsafeLoader)", "yaml.unsafe_load(p)",
        "from yaml import full_load", "np.load(p, allow_pickle=flag)",
    ],
)  # fmt: skip
def test_the_scan_sees_pickles(code):
    assert pickles(code)
