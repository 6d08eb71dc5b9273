"""Define the blocks `sample` and `search`, and generate the draws in the unit hypercube.

A design has one row for each draw and one column for each drawn key. In the designs `sobol` and `random`, draw k
depends only on the seed and on k. A shorter sample is therefore equal to the first draws of a longer sample. In the
design `sobol`, draw k is a point of sequence k modulo 8 of eight independently scrambled Sobol sequences [1]_. The
error of the overall mean is estimated from the scatter of the eight sequence means. A single sequence provides no error
estimate [2]_.

References
----------
.. [1] A. B. Owen, "Scrambling Sobol' and Niederreiter-Xing points", J. Complexity 14 (1998),
   doi 10.1006/jcom.1998.0487
.. [2] P. L'Ecuyer and C. Lemieux, "Recent advances in randomized quasi-Monte Carlo methods", in Modeling Uncertainty
   (2002), doi 10.1007/0-306-48102-2_20
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from heliosweep.config.blocks import Block, blocks_in
from heliosweep.config.faults import Fault, Invalid, did_you_mean, each, one_of, require, shown, when
from heliosweep.config.source import Source
from heliosweep.config.values import (
    LEAST,
    MAX_SEED,
    Choice,
    Drawn,
    Flag,
    Parameter,
    Quantity,
    Samples,
    Schema,
    Sweep,
    Text,
    object_schema,
    read_items,
    read_mapping,
)
from heliosweep.errors import Problem, load_extra
from heliosweep.lazy import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.config.study import Study


#: Number of Sobol sequences in a sample.
REPLICATES = 8
SOBOL, LATIN, RANDOM = "sobol", "latin_hypercube", "random"
MORRIS, LOCAL = "morris", "local"


@dataclass(frozen=True)
class Design:
    """Design of the draws of a study, expressed as probabilities.

    Parameters
    ----------
    kind : {"sobol", "latin_hypercube", "random"}
        Arrangement of the points in the unit hypercube.
    size : int
        Number of draws, or, for a sensitivity analysis, number of base points or trajectories.
    seed : int
        Seed of all draws.
    groups : tuple of int
        Index of the sensitivity parameter to which each drawn key belongs.
    sensitivity : {"", "sobol", "morris", "local"}
        Saltelli's design, trajectories of elementary effects, or steps of one parameter at a time. Empty without a
        sensitivity analysis.
    factor : tuple of tuple of float
        Rows of the Cholesky factor of the key correlation matrix. Empty for independent keys.
    """

    kind: str
    size: int
    seed: int
    groups: tuple[int, ...]
    sensitivity: str = ""
    factor: tuple[tuple[float, ...], ...] = ()

    @property
    def parameters(self) -> int:
        """Number of sensitivity parameters, which are groups of keys and ungrouped keys."""
        return max(self.groups) + 1

    @property
    def rows(self) -> int:
        """Number of draws for each base point or trajectory."""
        return {SOBOL: self.parameters + 2, MORRIS: self.parameters + 1}.get(self.sensitivity, 1)

    def __len__(self) -> int:
        return 2 * self.parameters + 1 if self.sensitivity == LOCAL else self.size * self.rows

    def points(self) -> NDArray[np.float64]:
        """Return the probabilities of all draws, shape (draws, keys), from `LEAST` to ``1 - LEAST``."""
        return _draws(self)


@lru_cache(maxsize=4)
def _draws(design: Design) -> NDArray[np.float64]:
    if design.sensitivity == LOCAL:  # the medians, then one standard deviation down and up for each parameter
        steps = np.full((len(design), len(design.groups)), 0.5)
        for key, parameter in enumerate(design.groups):
            steps[2 * parameter + 1 : 2 * parameter + 3, key] = scipy.special.ndtr([-1.0, 1.0])
        return steps
    if design.sensitivity == MORRIS:
        return 0.125 + 0.75 * levels(design)  # the probabilities of the first and the last level are 1/8 and 7/8
    points = np.clip(_points(design, len(design.groups) * (2 if design.sensitivity else 1)), LEAST, 1.0 - LEAST)
    if design.factor:
        # Gaussian copula. einsum is used because the rounding of a matrix product depends on its shape.
        factor = np.array(design.factor)
        points = np.clip(
            scipy.special.ndtr(np.einsum("dk,ck->dc", scipy.special.ndtri(points), factor)), LEAST, 1.0 - LEAST
        )
    if not design.sensitivity:
        return points
    # The first row of a base point contains the first half of the columns, and the last row contains the second half.
    # Each row in between contains the first half, except that the keys of one parameter come from the second half.
    first, second = (np.repeat(half, design.rows, axis=0) for half in np.split(points, 2, axis=1))
    row = np.tile(np.arange(design.rows), design.size)[:, np.newaxis]
    return np.where((np.array(design.groups) == row - 1) | (row == design.rows - 1), second, first)


def _points(design: Design, columns: int) -> NDArray[np.float64]:
    qmc = scipy.stats.qmc
    if design.kind == RANDOM:
        keys = [np.array([design.seed, column], np.uint64) for column in range(columns)]
        bits = np.stack([np.random.Philox(key=key, counter=0).random_raw(design.size) for key in keys], axis=1)
        return ((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
    if design.kind == LATIN:
        return np.asarray(qmc.LatinHypercube(columns, rng=np.random.default_rng(design.seed)).random(design.size))
    points = np.empty((design.size, columns))
    for sequence in range(REPLICATES):
        engine = qmc.Sobol(columns, rng=np.random.default_rng([design.seed, sequence]))
        points[sequence::REPLICATES] = engine.random(design.size // REPLICATES)
    return points + LEAST  # move each point to the middle of a step, so that no draw is 0


def levels(design: Design) -> NDArray[np.float64]:
    """Return the trajectories of elementary effects as levels between 0 and 1, shape (draws, keys)."""
    morris = load_extra("SALib.sample.morris", "SALib", "sensitivity")
    return np.asarray(morris.sample(problem(design), design.size, 4, seed=design.seed))


def problem(design: Design) -> dict[str, object]:
    """Return the problem definition that SALib requires."""
    names = [f"{number:05}" for number in range(len(design.groups))]
    groups = [f"{group:05}" for group in design.groups] if design.parameters < len(names) else None
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names), "groups": groups}


#: Name of the dimension of the draws.
SAMPLE = "sample"
#: Maximum number of draws.
MAX_SIZE = 2**20


class SampleStatistics(Block):
    """Statistics to store in addition to the mean, standard deviation and standard error."""

    percentiles: Annotated[
        Sweep, Samples("Percentiles of the draws", "1", ge=0, le=100, title="percentile")
    ] = Samples("", "1").read([5, 50, 95])  # fmt: skip
    every_draw: Annotated[
        bool,
        Flag("Also store every draw of results that contain one number per heliostat or more than 100 numbers"),
    ] = False


class Sample(Block):
    """Random sample of the keys whose values are distributions."""

    size: Annotated[
        int | None,
        Quantity("Number of draws (number of base points with 'sensitivity: sobol', number of trajectories with "
                 "'sensitivity: morris')", "1",
                 ge=2, le=MAX_SIZE, integer=True, sweep=False),
    ] = None  # fmt: skip
    seed: Annotated[int, Quantity("Seed of all draws", "1", ge=0, le=MAX_SEED, integer=True, sweep=False)] = 0
    design: Annotated[
        str,
        Choice(
            "Sampling design of the draws",
            {
                SOBOL: "eight independently scrambled Sobol sequences, the most accurate design",
                LATIN: "one draw in each stratum of each key, with as many strata as draws; a larger sample does not "
                "begin with the draws of a smaller sample",
                RANDOM: "independent draws",
            },
            sweep=False,
        ),
    ] = SOBOL
    sensitivity: Annotated[
        str | None,
        Choice(
            "Sensitivity analysis in addition to the statistics",
            {
                SOBOL: "variance-based first-order and total indices of each key, from size x (keys + 2) draws",
                MORRIS: "elementary effects of each key along trajectories, from size x (keys + 1) draws",
                LOCAL: "change in the result when one key changes by one standard deviation, from 2 x keys + 1 draws",
            },
            sweep=False,
        ),
    ] = None
    correlation: Annotated[
        tuple[
            tuple[
                Annotated[str, Text("Key")],
                Annotated[str, Text("Key")],
                Annotated[float, Quantity("Correlation", "1", gt=-1, lt=1, sweep=False)],
            ],
            ...,
        ],
        Field(
            description="Correlations between the normal deviates of two drawn keys (Gaussian copula), each as "
            "[key, key, number]"
        ),
    ] = ()
    groups: Annotated[
        dict[str, tuple[Annotated[str, Text("Key")], ...]],
        Field(description="Groups of drawn keys that share one sensitivity index, by group name"),
    ] = {}  # noqa: RUF012
    statistics: Annotated[SampleStatistics, Field(description="Statistics of the draws to store")] = SampleStatistics()

    def rules(self) -> Iterator[Fault]:
        """Check that the size suits the design, and that the sensitivity analysis uses every given key."""
        kind, size = self.sensitivity, self.size
        purpose, own_design = f"cannot be used with 'sensitivity: {kind}'", kind in (MORRIS, LOCAL)
        wrong = (
            ("size", kind == LOCAL and size is not None,
             f"{purpose}, which determines its own number of draws: remove it"),
            ("design", own_design and self.design != SOBOL, f"{purpose}, which has its own design: remove it"),
            ("design", kind == SOBOL and self.design == LATIN, f"{purpose}: use sobol or random"),
            ("correlation", kind and self.correlation, "cannot be used with 'sensitivity', which requires "
             "independent keys: remove it"),
            ("groups", self.groups and not kind, "require 'sensitivity', which is not set: remove this key"),
            ("statistics", own_design and self.statistics != SampleStatistics(), f"{purpose}, because its draws "
             "do not follow the distributions: remove it"),
        )  # fmt: skip
        is_sobol = self.design == SOBOL and not own_design
        near = max(2 * REPLICATES, 2 ** ((size or 1).bit_length() - 1))
        power = f"must be a power of two for 'design: sobol', such as {near:,} or {2 * near:,}"
        return when(
            *((applies, Fault(message, (key,), key in ("size", "design"))) for key, applies, message in wrong),
            (kind != LOCAL and size is None, Fault("'size' is missing: the number of draws", show_value=False)),
            (size and is_sobol and (size < 2 * REPLICATES or size & (size - 1)), Fault(power, ("size",))),
        )


def drawn_keys(study: Study) -> dict[str, Drawn]:
    """Return the distributions of the drawn keys of a study, by dotted key."""
    return {key: value for key, _, value in study.parameters() if isinstance(value, Drawn)}


def columns_of(study: Study) -> dict[str, str]:
    """Map each drawn key to the key of its design column. Keys tied by `zip` share the column of the first key."""
    keys = list(drawn_keys(study))
    first = {key: min(group, key=keys.index) for group in study.tied_keys() if group[0] in keys for key in group}
    return {key: first.get(key, key) for key in keys}


def sample_problems(study: Study) -> Iterator[Problem]:
    """Yield a problem for each conflict between the `sample` block and the drawn keys of a study."""
    columns, sample = columns_of(study), study.sample
    drawn = list(dict.fromkeys(columns.values()))
    if sample is None or not drawn:
        form = "write a distribution instead of a number, such as {normal: [mean, standard deviation]}"
        message = f"no key has a distribution; {form}, or remove 'sample'"
        if drawn:
            message = "is a distribution, but the number of draws is missing: add 'sample: {size: 256}'"
        yield from (study.problem(key, message) for key in [*drawn[:1], *["sample"] * (sample is not None)])
        return
    message, series = "time series are not stored for draws: remove it, or 'sample'", ("time_series", "field_series")
    yield from (study.problem(f"output.{key}", message) for key in series if getattr(study.output, key, False))
    yield from _group_problems(study, sample, columns)
    pairs = [frozenset(pair[:2]) for pair in sample.correlation]
    for position, pair in enumerate(pairs):
        if len(pair) < 2 or pair in pairs[:position]:
            message = f"{' and '.join(sorted(pair))}: give two different keys, and each pair once"
            yield study.problem(f"sample.correlation[{position}]", message)
    if all(len(pair) == 2 and pair <= set(drawn) for pair in pairs):
        if _factor(sample, drawn) is None:
            message = "the correlation matrix is not positive definite: use smaller correlations"
            yield study.problem("sample.correlation", message)
        elif (draws := len(design_of(study))) > MAX_SIZE:
            yield study.problem("sample.size", f"results in {draws:,} draws, but the maximum is {MAX_SIZE:,}")


def _group_problems(study: Study, sample: Sample, columns: Mapping[str, str]) -> Iterator[Problem]:
    """Yield a problem for each invalid group, and for each tied or undrawn key in a correlation or group."""
    drawn = list(dict.fromkeys(columns.values()))
    members = {f"groups.{name}[{j}]": key for name, keys in sample.groups.items() for j, key in enumerate(keys)}
    pairs = {f"correlation[{i}][{j}]": str(pair[j]) for i, pair in enumerate(sample.correlation) for j in (0, 1)}
    for place, key in (pairs | members).items():
        if key not in drawn:
            hint = did_you_mean(key, drawn) or f"; the drawn keys are {', '.join(drawn)}"
            tied = f"is tied to {columns[key]}: give that key" if key in columns else f"is not a drawn key{hint}"
            yield study.problem(f"sample.{place}", f"{tied} (got {shown(key)})")
    for key in sorted(key for key, count in Counter(members.values()).items() if count > 1):
        yield study.problem("sample.groups", f"{key} occurs in two groups, or twice in one group")
    for name, keys in sample.groups.items():
        if name in drawn and name not in keys:
            yield study.problem(f"sample.groups.{name}", "is the name of a drawn key: use another name")


def _factor(sample: Sample, keys: list[str]) -> tuple[tuple[float, ...], ...] | None:
    """Return the rows of the Cholesky factor of the key correlation matrix.

    Returns an empty tuple if the study specifies no correlations, and None if the matrix is not positive definite.
    """
    matrix = np.eye(len(keys))
    for first, second, correlation in sample.correlation:
        row, column = keys.index(first), keys.index(second)
        matrix[row, column] = matrix[column, row] = correlation
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return None
    return (
        () if not sample.correlation else tuple(map(tuple, factor.tolist())) if np.diag(factor).min() > 1e-6 else None
    )


def _parameters(study: Study) -> list[str]:
    """Return the sensitivity parameter of each design column: the group of the key, or the key if it is ungrouped."""
    assert study.sample is not None
    group_of = {key: name for name, members in study.sample.groups.items() for key in members}
    return [group_of.get(key, key) for key in dict.fromkeys(columns_of(study).values())]


def parameter_names(study: Study) -> list[str]:
    """Return the ordered names of the sensitivity parameters. A parameter is a group or an ungrouped key."""
    return list(dict.fromkeys(_parameters(study)))


def design_of(study: Study) -> Design:
    """Return the design of the draws of a study."""
    sample, keys = study.sample, list(dict.fromkeys(columns_of(study).values()))
    assert sample is not None
    groups = tuple(map(parameter_names(study).index, _parameters(study)))
    return Design(
        sample.design, sample.size or 0, sample.seed, groups, sample.sensitivity or "", _factor(sample, keys) or ()
    )


def bind_draws(study: Study) -> None:
    """Assign the design of the study and a design column to each drawn key."""
    columns = columns_of(study)
    order = list(dict.fromkeys(columns.values()))
    for key, value in drawn_keys(study).items():
        value.design, value.column = design_of(study), order.index(columns[key])


#: Name of the dimension of a search result.
EVALUATION = "evaluation"
_FORM = "write [low, high], or {choice: [...]}"


@dataclass(frozen=True)
class Results(Parameter):
    """Name of a result, or a list of names."""

    def read(self, raw: Any) -> tuple[str, ...]:
        """Return the names. Raises Invalid."""
        names = raw if isinstance(raw, list | tuple) else (raw,)
        named = all(isinstance(name, str) and name.strip() for name in names)
        require(named, "must be the name of a result, or a list of two names")
        return read_items(names, str) if names else ()

    def _one_schema(self) -> Schema:
        one = super()._one_schema()
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "maxItems": 2}]}


@dataclass(frozen=True)
class Extent(Parameter):
    """Values of a searched key before conversion to the unit of the key: ``[low, high]`` or ``{choice: [...]}``."""

    def read(self, raw: Any) -> Any:
        """Return bounds as a tuple, or choices as a mapping. `with_search` has already checked and converted them."""
        return tuple(raw) if isinstance(raw, list) else raw

    def _one_schema(self) -> Schema:
        return {"anyOf": [{"type": "array", "minItems": 2, "maxItems": 2}, object_schema("", {"choice": {}})]}


class Limit(Block):
    """Bounds on a result, in the unit of the result."""

    at_least: Annotated[float | None, Quantity("Minimum of the result, in its unit", "1", sweep=False)] = None
    at_most: Annotated[float | None, Quantity("Maximum of the result, in its unit", "1", sweep=False)] = None

    def rules(self) -> Iterator[Fault]:
        """Check that there is at least one bound, and that the minimum does not exceed the maximum."""
        low, high = self.at_least, self.at_most
        return when(
            (low is None and high is None, Fault("give 'at_least', 'at_most' or both", show_value=False)),
            (low is not None and high is not None and low > high, Fault("must not exceed 'at_most'", ("at_least",))),
        )


class Search(Block):
    """Search for the best point of a study. Each evaluation uses different values of the searched keys."""

    maximise: Annotated[tuple[str, ...], Results("One or two results to maximise")] = ()
    minimise: Annotated[tuple[str, ...], Results("One or two results to minimise")] = ()
    over: Annotated[
        dict[str, Annotated[Any, Extent("Minimum and maximum of the key, or a choice of values")]],
        Field(
            description="Keys to search, such as receiver.height, with their bounds or choices",
            min_length=1,
            max_length=20,
        ),
    ]
    budget: Annotated[
        int, Quantity("Maximum number of evaluations", "1", ge=1, le=100_000, integer=True, sweep=False)
    ]  # fmt: skip
    seed: Annotated[
        int,
        Quantity("Seed of the search", "1", ge=0, le=MAX_SEED, integer=True,
                 sweep=False),
    ] = 0  # fmt: skip
    subject_to: Annotated[
        dict[str, Limit],
        Field(description="Bounds on results: 'at_least', 'at_most' or both for each result"),
    ] = Field(default_factory=dict)

    def rules(self) -> Iterator[Fault]:
        """Check that there are one or two objectives and enough evaluations for one generation."""
        goals, named = len(self.goals()), len(self.maximise) + len(self.minimise)
        needed = population(len(self.over), goals)
        message = f"must be at least {needed}, the size of one generation in a search over {len(self.over)} keys"
        front = "give one result to 'maximise' or 'minimise', or two results for a Pareto front"
        return when(
            (not 1 <= named <= 2, Fault(front, show_value=False)),
            (goals < named == 2, Fault("is also maximised: remove one of them", ("minimise",))),
            (1 <= goals == named <= 2 and self.budget < needed, Fault(message, ("budget",))),
        )

    def goals(self) -> dict[str, float]:
        """Return the sign of each objective: 1 to minimise, -1 to maximise."""
        return dict.fromkeys(self.maximise, -1.0) | dict.fromkeys(self.minimise, 1.0)

    def searched(self) -> tuple[str, ...]:
        """Return the searched keys in an order that does not depend on their order in the file."""
        return tuple(sorted(self.over))


def population(keys: int, goals: int) -> int:
    """Return the number of evaluations in one generation of a search."""
    return max(10, 5 * keys) if goals < 2 else 4 * (4 + 2 * keys)


def searchable(block: type[Block], prefix: str = "") -> dict[str, Parameter]:
    """Return the declarations of all searchable keys in a block, by dotted key."""
    found: dict[str, Parameter] = {}
    for name, field in block.model_fields.items():
        declared = block.parameter(name)
        if declared is None:
            for _, inner in blocks_in(field.annotation):
                found = searchable(inner, f"{prefix}{name}.") | found
        elif declared.sweep and isinstance(declared, Quantity | Choice) and not isinstance(declared, Samples):
            found[f"{prefix}{name}"] = declared
    return found


def with_search(source: Source, study_class: type[Study], problems: list[Problem]) -> Source:
    """Return a study in which each searched key has a start value and bounds in the unit of the key.

    If a searched key has no value, the search starts at the middle of its bounds, or at the first choice. Problems with
    searched keys are added to `problems`.
    """
    search = source.data.get("search")
    over = search.get("over") if isinstance(search, dict) else None
    data, known = copy.deepcopy(source.data), searchable(study_class)
    for key, extent in over.items() if isinstance(over, dict) else ():
        place = ("search", "over", key)
        if extent is None:  # reported as empty
            continue
        if key not in known:
            hint = did_you_mean(key, known) or ": only keys that can be swept can be searched"
            problems.append(source.problem(place, f"is not a key that can be searched{hint}", at_key=True))
            continue
        try:
            data["search"]["over"][key], first = _read(known[key], extent)
            block, (*outer, name) = data, key.split(".")
            for part in outer:
                block = block.setdefault(part, {}) if isinstance(block, dict) else {}
            if isinstance(block, dict):
                block.setdefault(name, first)
        except Invalid as error:
            problems += (source.problem((*place, *fault.path), fault.message) for fault in error.faults)
    return replace(source, data=data)


def _read(declared: Parameter, extent: Any) -> tuple[Any, Any]:
    """Return the bounds or choices in the unit of the key, and the start value of the search. Raises Invalid."""
    one = replace(declared, sweep=False)

    def choices(values: Any) -> list[Any]:
        several = isinstance(values, list) and len(values) > 1
        require(several, f"must be a list of at least two values (got {shown(values)})")
        return list(read_items(values, one.read))

    if isinstance(extent, dict):
        read = read_mapping(extent, {"choice": choices}, ("choice",), _FORM)
        return read, read["choice"][0]
    pair = isinstance(extent, list) and len(extent) == 2
    require(pair, f"must be the minimum and the maximum: {_FORM} (got {shown(extent)})")
    require(
        isinstance(declared, Quantity), "must be a choice, because the values of the key are names: {choice: [...]}"
    )
    low, high = each(extent, one.read)
    require(low < high, "the first number must be smaller than the second")
    close = high - low < max(1e-9 * max(abs(low), abs(high)), 1e-250)
    require(not close, "the numbers are too close together for a search")
    middle = low + (high - low) / 2
    return [low, high], int(middle) if isinstance(low, int) else middle


def search_problems(study: Study) -> Iterator[Problem]:
    """Yield a problem for each conflict between a search and other keys of the study."""
    search: Search | None = study.search
    if search is None:
        return
    given = {key: value for key, _, value in study.parameters()}
    for key, sweep in study.sweeps().items():
        message = f"has {len(sweep)} values, but a search has one result for each evaluation: give one value, or search"
        message = f"{message} over it as {{choice: [...]}}"
        if isinstance(sweep, Drawn):
            message = "is drawn from a distribution, which a search does not support: give one value"
        yield study.problem(key, message)
    for key, extent in search.over.items():
        value, message = given.get(key), "is the starting value of the search and must be"
        if value is None:
            yield study.source.problem(("search", "over", key), "is not used by this study")
        elif not isinstance(value, int | float | str | Sweep):
            yield study.problem(key, "is both drawn from a distribution and searched: give one value, or remove it")
        elif isinstance(extent, dict) and not isinstance(value, Sweep) and value not in extent["choice"]:
            yield study.problem(key, f"{message} {one_of(map(str, extent['choice']))}")
        elif isinstance(extent, tuple) and not isinstance(value, Sweep) and not extent[0] <= value <= extent[1]:
            yield study.problem(key, f"{message} between {extent[0]:g} and {extent[1]:g}, its bounds")
    if study.report.published is not None:
        yield study.problem("report.published", "applies only to sweeps: remove it, or 'search'")
    if study.sample is not None:
        yield study.problem("sample", "cannot be combined with a search: remove one of them")
