"""Find the family of a study or result, and wrap the family if the study has draws or a search."""

from __future__ import annotations

import itertools
import json
import math
import pkgutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config import (
    EVALUATION,
    LOCAL,
    MORRIS,
    RANDOM,
    REPLICATES,
    SAMPLE,
    SOBOL,
    Study,
    Sweep,
    design_of,
    did_you_mean,
    drawn_keys,
    few_of,
    in_short,
    parameter_names,
    population,
    replaced,
)
from heliosweep.errors import Problem, StudyError
from heliosweep.families.family import Family, families
from heliosweep.grid import (
    BEST_VALUE,
    EMPTY_FILE,
    LARGEST,
    SMALLEST,
    Cut,
    Plan,
    Region,
    Variable,
    Workload,
    bytes_of,
    statistics,
)
from heliosweep.lazy import xr

if TYPE_CHECKING:
    from heliosweep.report.figures import Figure
    from heliosweep.report.tables import Table
    from heliosweep.search.optimise import Space


PARAMETER, PERCENTILE = "parameter", "sample_percentile"
#: Maximum number of values per draw for which all draws of a variable are stored, unless `every_draw` is set.
MOST_NUMBERS = 100
#: Maximum width of the confidence interval of a total index; a warning is given for wider intervals. [1]
WIDE = 0.1

#: Statistics of each variable. Keys are suffixes of variable names. Values are the additional dimensions, the long
#: name, and the names of attributes that are copied from the variable.
_STATISTICS: dict[str, tuple[tuple[str, ...], str, tuple[str, ...]]] = {
    "sample_mean": ((), "mean of the {} over the draws", ("units", "cell_methods", "valid_range", BEST_VALUE)),
    "sample_standard_deviation": (
        (),
        "sample standard deviation of the {} over the draws",
        ("units", "cell_methods", "valid_range"),
    ),
    "sample_standard_error": (
        (),
        "standard error of the mean of the {} over the draws",
        ("units", "cell_methods", "valid_range"),
    ),
    "sample_percentile": (
        (PERCENTILE,),
        "percentiles of the {} over the draws",
        ("units", "cell_methods", "valid_range", BEST_VALUE),
    ),
}
_SENSITIVITIES: dict[str, dict[str, tuple[tuple[str, ...], str, tuple[str, ...]]]] = {
    SOBOL: {
        "first_order_index": (
            (PARAMETER,),
            "fraction of the variance of the {} that each parameter explains alone",
            (),
        ),
        "first_order_interval": (
            (PARAMETER,),
            "half-width of the 95 % confidence interval of the first-order index of the {}",
            (),
        ),
        "total_index": (
            (PARAMETER,),
            "fraction of the variance of the {} that each parameter explains alone and through interactions",
            (),
        ),
        "total_interval": ((PARAMETER,), "half-width of the 95 % confidence interval of the total index of the {}", ()),
    },
    MORRIS: {
        "effect_mean": ((PARAMETER,), "mean elementary effect of each parameter on the {}", ("units",)),
        "effect_mean_magnitude": ((PARAMETER,), "mean magnitude of the elementary effects on the {}", ("units",)),
        "effect_standard_deviation": (
            (PARAMETER,),
            "standard deviation of the elementary effects on the {}",
            ("units",),
        ),
    },
    LOCAL: {
        "change_down": (
            (PARAMETER,),
            "change of the {} if each parameter decreases by one standard deviation",
            ("units",),
        ),
        "change_up": (
            (PARAMETER,),
            "change of the {} if each parameter increases by one standard deviation",
            ("units",),
        ),
    },
}


class Wrapped(Family):
    """Family that delegates its computations to another family `inner`."""

    def __init__(self, inner: Family) -> None:
        vars(self).update(vars(inner))
        self.inner = inner

    def __reduce_ex__(self, protocol: Any) -> Any:
        return type(self), (self.inner,)


class Sampled(Wrapped):
    """Family that computes each draw with the family `inner`, along the ``sample`` dimension.

    All variables of a draw are computed variables, even if `inner` declares them as `finished`. The `finished`
    variables are the statistics over the draws.
    """

    def __init__(self, inner: Family) -> None:
        super().__init__(inner)
        self.headlines, self._answers = tuple(f"{name}_sample_mean" for name in inner.headlines), None

    def workload(self, study: Any) -> Workload:
        """Return the workload of all draws. Points are not split. Raises StudyError if dimension names conflict."""
        work = self.inner.workload(study)
        own = [*work.inner, *(name for name in work.parameters if name != SAMPLE)]
        for dim in (dim for dim in (*self._sizes(study), SAMPLE) if dim in own):
            raise StudyError(
                study.problem("sample", f"the result already has a dimension {dim!r}, which the draws also need")
            )
        length = work.inner.get(work.splittable, 1)
        return replace(
            work,
            inner={**work.inner, **self._sizes(study)},
            splittable="",
            whole=(*work.whole, SAMPLE),
            uncut=(*work.whole, *work.uncut),
            working_bytes=lambda points, _: work.working_bytes(points, length),
            coordinate_bytes=work.coordinate_bytes + 8 * work.parameters[SAMPLE] * (len(drawn_keys(study)) + 1),
        )

    def _sizes(self, study: Any) -> dict[str, int]:
        design, sizes = design_of(study), dict[str, int]()
        if statistics.has_statistics(design):
            sizes[PERCENTILE] = len(study.sample.statistics.percentiles)
        if design.sensitivity:
            sizes[PARAMETER] = design.parameters
        return sizes

    def variables(self, study: Any) -> dict[str, Variable]:
        """Return the variables of each draw and their statistics. Variables that are not stored are `passing`."""
        work, found = self.inner.workload(study), dict[str, Variable]()
        design, sample = design_of(study), study.sample
        statistical = _STATISTICS if statistics.has_statistics(design) else {}
        for name, one in self.inner.variables(study).items():
            if SAMPLE not in one.dims or one.dtype.kind != "f":
                found[name] = replace(one, finished=False)
                continue
            others = tuple(dim for dim in one.dims if dim != SAMPLE)
            numbers = math.prod(work.inner[dim] for dim in others if dim in work.inner)
            large = "heliostat" in others or numbers > MOST_NUMBERS
            passing = large and not sample.statistics.every_draw
            if passing and not statistical:
                continue
            found[name] = replace(one, dims=(*others, SAMPLE), finished=False, passing=passing)
            made = dict(statistical)
            if design.sensitivity and not large and numbers <= 12:  # limit the number of sensitivity variables
                made |= _SENSITIVITIES[design.sensitivity]
            for ending, (dims, words, kept) in made.items():
                attrs = _attributes(one, words, kept)
                if ending in _SENSITIVITIES[MORRIS]:
                    attrs["comment"] = "change from the 12.5 % to the 87.5 % quantile of the parameter"
                found[f"{name}_{ending}"] = Variable((*others, *dims), attrs, finished=True)
        return found

    def coordinates(self, study: Any) -> xr.Dataset:
        """Return the inner family's coordinates, with parameter names, percentiles and a description of the draws."""
        labels = self.inner.coordinates(study)
        sizes, sample = self._sizes(study), study.sample
        if not sample.statistics.every_draw:  # the heliostat positions of each draw are not needed
            labels = labels.drop_vars(
                [name for name, one in labels.coords.items() if SAMPLE in one.dims and one.ndim > 1]
            )
        if PERCENTILE in sizes:
            attrs = {"long_name": "percentile of the draws", "units": "percent"}
            labels = labels.assign_coords({PERCENTILE: (PERCENTILE, sample.statistics.percentiles.values(), attrs)})
        if PARAMETER in sizes:
            names = np.array(parameter_names(study), dtype=object)
            labels = labels.assign_coords({PARAMETER: (PARAMETER, names, {"long_name": "drawn key, or group of keys"})})
        return labels.assign_attrs(sample_design=_words(study))

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Compile or load the kernels of the inner family."""
        return self.inner.prepare(study)

    def inputs(self, study: Any) -> Any:
        """Return the contents of the inner family's input files."""
        return self.inner.inputs(study)

    def compute(self, study: Any, inputs: Any, region: Region) -> xr.Dataset:
        """Compute all variables of the inner family for the draws in a region."""
        computed = self.inner.compute(study, inputs, region)
        if any(one.finished for one in self.inner.variables(study).values()):
            computed = computed.assign(self.inner.finish(study, inputs, region, computed).data_vars)
        return computed

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        """Compute the statistics over all draws."""
        design, made, wanted = design_of(study), dict[str, Any](), self.variables(study)
        percentiles = study.sample.statistics.percentiles.values()
        for name, array in computed.data_vars.items():
            if SAMPLE not in array.dims or array.dtype.kind != "f":
                continue
            values, results = np.ascontiguousarray(array.transpose(..., SAMPLE).to_numpy()), list[np.ndarray]()
            if statistics.has_statistics(design):
                results = [*statistics.mean_of_draws(values, design)]
                results.append(statistics.percentiles_of_draws(values, percentiles, design))
            names = [f"{name}_{ending}" for ending in _STATISTICS][: len(results)]
            of = _SENSITIVITIES.get(design.sensitivity, {})
            if of and f"{name}_{next(iter(of))}" in wanted:
                names += [f"{name}_{ending}" for ending in of]
                results += {
                    SOBOL: statistics.sobol_indices,
                    MORRIS: statistics.elementary_effects,
                    LOCAL: lambda values, _: statistics.single_steps(values),
                }[design.sensitivity](values, design)
            made |= {each: (wanted[each].dims, values) for each, values in zip(names, results, strict=True)}
        return xr.Dataset(made)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Yield a remark for each variable whose total indices have wide confidence intervals."""
        for name, array in result.data_vars.items():
            if str(name).endswith("_total_interval") and (wide := float(2 * array.max())) > WIDE:
                what = str(name).removesuffix("_total_interval")
                wider = f"is {wide:.3f} wide, more than {WIDE}: increase the sample size"
                yield f"{what}: the confidence interval of a total index {wider}"

    def figures(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return figures of the distribution of each result and its sensitivity to each drawn key."""
        from heliosweep.report.draws import figures

        return [*self.inner.figures_of_draws(result), *figures(result, self.inner.headlines)]

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Return tables of the statistics of each result and the sensitivity indices of each drawn key."""
        from heliosweep.report.draws import tables

        return tables(result, self.inner.headlines)


def _attributes(one: Variable, words: str, kept: Iterable[str]) -> dict[str, Any]:
    """Return the attributes of a statistic of a variable: its long name, and the attributes `kept` of the variable."""
    attrs = {"units": "1", "long_name": words.format(one.attrs.get("long_name", "result"))}
    return attrs | {name: one.attrs[name] for name in kept if name in one.attrs}


def _words(study: Study) -> str:
    """Describe the sampling design, and how standard errors and confidence intervals are computed."""
    design = design_of(study)
    if design.sensitivity == LOCAL:
        return "all keys at their medians, then each parameter one standard normal deviate below and above its median"
    if design.sensitivity == MORRIS:
        return f"{design.size} trajectories of elementary effects, four levels from the 12.5 % to the 87.5 % quantile"
    what = {
        SOBOL: f"{REPLICATES} independently scrambled Sobol sequences, draw k from sequence k modulo {REPLICATES}; "
        "standard errors are computed from the means of the sequences",
        RANDOM: "independent draws; standard errors are computed from their standard deviation",
    }.get(
        design.kind,
        "Latin hypercube; standard errors are computed as for independent draws and are therefore too large",
    )
    if design.sensitivity != SOBOL:
        return what
    how = f"a jackknife over the {REPLICATES} sequences and Student's t" if design.kind == SOBOL else "a bootstrap"
    return f"Saltelli design based on {what}; 95 % confidence intervals of indices from {how}"


class Searched(Wrapped):
    """Family that searches for the best point of a study of the family `inner`.

    Each evaluation computes the study with different values of the searched keys. `single` returns the study for one
    evaluation. `generation` returns a study that sweeps the points of many evaluations. Both studies belong to the
    family `inner`.
    """

    def __init__(self, inner: Family) -> None:
        super().__init__(inner)
        self.title = f"Search for the best point: {inner.title[:1].lower()}{inner.title[1:]}"
        self._figures, self._tables, self._remarks, self._answers = (
            f"heliosweep.search.result:{name}" for name in ("figures", "tables", "remarks", "answers")
        )

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Load or compile the kernels that the evaluations need."""
        return self.inner.prepare(self.single(study, {}))

    def single(self, study: Any, point: Mapping[str, Any]) -> Study:
        """Return the study for a single point. Keys that are not in the point keep their values."""
        return _with(study, point, {})

    def generation(self, study: Any, points: Sequence[Mapping[str, Any]]) -> Study:
        """Return a study that sweeps the points along one dimension."""
        keys = study.search.searched()
        columns = {key: Sweep(tuple(point[key] for point in points)) for key in keys}
        return _with(study, columns, {"zip": (keys,) if len(keys) > 1 else ()})

    def space(self, study: Any) -> Space:
        """Return the bounds of the searched keys. Choices of a key are numbered from 0."""
        from heliosweep.search.optimise import Space

        ends = [(0, len(extent["choice"]) - 1) if isinstance(extent, dict) else extent for *_, extent in _keys(study)]
        low, high = np.array(ends, dtype=float).T
        return Space(low, high, np.array([integer for _, _, integer, _ in _keys(study)]))

    def point(self, study: Any, numbers: Iterable[float]) -> dict[str, Any]:
        """Convert the coordinates of a point in the `space` to values of the searched keys."""
        return {
            key: extent["choice"][int(number)] if isinstance(extent, dict) else int(number) if integer else number
            for (key, _, integer, extent), number in zip(_keys(study), numbers, strict=True)
        }

    def start(self, study: Any) -> np.ndarray:
        """Return the start point of the search in the `space`: the study's values of the searched keys."""
        return np.array([
            extent["choice"].index(value) if isinstance(extent, dict) else value for _, value, _, extent in _keys(study)
        ], dtype=float)  # fmt: skip

    def wrong(self, study: Any, point: Mapping[str, Any]) -> Problem | None:
        """Return the problem that makes a point infeasible, such as colliding mirrors, or None."""
        try:
            return next(iter(self.single(study, point).check()), None)
        except StudyError as error:
            return error.problems[0]

    def results(self, study: Any) -> dict[str, Variable]:
        """Return the scalar variables, which can be objectives or constraints."""
        one = self.generation(study, [{key: value for key, value, _, _ in _keys(study)}])
        (swept,), sizes = one.dimensions(), self.inner.workload(one).sizes
        return {
            name: each
            for name, each in self.inner.variables(one).items()
            if each.dtype.kind in "fiu" and swept.name in each.dims and math.prod(sizes[dim] for dim in each.dims) == 1
        }

    def check(self, study: Any) -> Iterator[Problem]:
        """Yield a problem for each objective or constraint that is not a scalar result."""
        search, known = study.search, self.results(study)
        others = self.inner.variables(self.single(study, {}))
        named = [(("search", way), name) for way in ("maximise", "minimise") for name in getattr(search, way)]
        seen: dict[tuple[bool, str], str] = {}
        for place, name in (*named, *((("search", "subject_to", name), name) for name in search.subject_to)):
            if (result := result_name(name, known)) in known:
                if (other := seen.setdefault((len(place) > 2, result), name)) != name:
                    yield study.source.problem(place, f"{name} is the same result as {other}: list it once")
                continue
            if name in others:
                along = " and ".join(others[name].dims)
                why = (
                    f"{name} has a value for each {along}" if along else f"{name} does not depend on the searched keys"
                )
            else:
                alike = [one for one in known if name in one]
                hint = (
                    f"; results with '{name}' in their names: {few_of(alike)}" if alike else did_you_mean(name, known)
                )
                if (key := self.inner.optional.get(result_name(name, self.inner.optional))) is not None:
                    hint = f"; with '{key}' it is"
                why = f"{in_short(name)} is not a result of this study{hint}"
            there = f"scalar results are {', '.join(known)}" if known else "no result has a single number at each point"
            yield study.source.problem(place, f"{why}; {there}")

    def variables(self, study: Any) -> dict[str, Variable]:
        """Return the variables stored for each evaluation: the dotted keys that are searched, and the `results`."""
        keys = {key: Variable((EVALUATION,), {}) for key in study.search.searched()}
        found, ways = self.results(study), (("maximise", LARGEST), ("minimise", SMALLEST))
        best = {result_name(name, found): {BEST_VALUE: end} for way, end in ways for name in getattr(study.search, way)}
        return keys | {
            name: Variable((EVALUATION,), {**one.attrs, **best.get(name, {})}) for name, one in found.items()
        }

    def coordinates(self, study: Any) -> xr.Dataset:
        """Return the scalar coordinates that all evaluations share."""
        labels = self.inner.coordinates(self.single(study, {}))
        varied = {*self.generation(study, [self.point(study, self.start(study))]).dimension_names().values()}
        return labels.drop_vars([name for name, one in labels.coords.items() if one.ndim or str(name) in varied])

    def first(self, study: Any) -> Study:
        """Return a study with a full generation, for the plan.

        The generation repeats the start point, and the lower and upper bounds if these points are feasible.
        """
        search, space = study.search, self.space(study)
        ends = [self.point(study, numbers) for numbers in (self.start(study), space.low, space.high)]
        built = [ends[0], *(point for point in ends[1:] if self.wrong(study, point) is None)]
        count = population(len(space), len(search.goals()))
        return self.generation(study, list(itertools.islice(itertools.cycle(built), count)))

    def workload(self, study: Any) -> Workload:
        """Return the dimension sizes and the cost of a search that uses its full budget.

        `plan` adds the memory for a generation.
        """
        of_one = self.inner.workload(self.first(study))
        return Workload(
            {EVALUATION: study.search.budget},
            {},
            of_one.evaluations,
            of_one.unit,
            lambda points, length: 0,
            axes=of_one.axes,
        )

    def plan(self, study: Any, generation: Plan) -> Plan:
        """Derive the plan of a search from the plan of its `first` generation. Each evaluation is a chunk."""
        work, variables = self.workload(study), self.variables(study)
        return Plan(
            work,
            variables,
            {"points": Cut(work.sizes, work.sizes, {EVALUATION: 1})},
            generation.workers,
            generation.peak_memory,
            bytes_of(variables, work.sizes) + EMPTY_FILE,
        )


def result_name(name: str, known: Iterable[str]) -> str:
    """Return the full name of a stored result. The prefix ``field_`` can be omitted in `name`."""
    return name if name in known or f"field_{name}" not in known else f"field_{name}"


def _keys(study: Any) -> list[tuple[str, Any, bool, Any]]:
    """Return a tuple for each searched key: name, value, True for an integer or a choice, and bounds."""
    declared = {key: (value, getattr(one, "integer", False)) for key, one, value in study.parameters()}
    over = study.search.over
    return [(key, declared[key][0], declared[key][1] or isinstance(over[key], dict), over[key])
            for key in study.search.searched()]  # fmt: skip


def _with(study: Any, values: Mapping[str, Any], changes: Mapping[str, Any]) -> Study:
    """Return the study with the given key values and without its search.

    All scalar outputs are enabled and all time series are disabled.
    """
    output, series = study.output, ("time_series", "field_series")
    wanted = dict.fromkeys(type(output).OF_POINTS, True) | {
        name: False for name in series if name in type(output).model_fields
    }
    made = study.model_copy(update={"search": None, "output": output.model_copy(update=wanted), **changes})
    for key, value in values.items():
        made = replaced(made, key, value)
    return made


def family_of(study: Study) -> Family:
    """Return the family of a study, wrapped as `Sampled` or `Searched` if the study has draws or a search."""
    family = families()[study.family]
    family = family if study.sample is None else Sampled(family)
    return family if study.search is None else Searched(family)


def family_of_result(result: xr.Dataset) -> Family | None:
    """Return the family of a result, wrapped as in `family_of`, or None if the family is not installed."""
    study = json.loads(result.attrs.get("study", "{}"))
    family = families().get(study.get("family"))
    if family is None:
        return None
    family = family.of_result(result)
    if "sample" in study:
        family = Sampled(family)
    if study.get("search"):
        family = Searched(family)
        family.headlines = tuple(pkgutil.resolve_name("heliosweep.search.result:goals_of")(result))
    return family
