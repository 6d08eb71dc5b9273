"""A family with drawn keys: the result of each draw, statistics over all draws, and sensitivities to the keys."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.sample import (
    LOCAL,
    MORRIS,
    RANDOM,
    REPLICATES,
    SAMPLE,
    SOBOL,
    design_of,
    drawn_keys,
    parameter_names,
)
from heliosweep.errors import StudyError
from heliosweep.families.family import Family
from heliosweep.grid import statistics
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import BEST_VALUE, Variable

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study
    from heliosweep.grid.regions import Region
    from heliosweep.report.figures import Figure
    from heliosweep.report.tables import Table

PARAMETER, PERCENTILE = "parameter", "sample_percentile"
#: Maximum numbers per draw of a variable with stored draws, unless the study sets `every_draw`.
MOST_NUMBERS = 100
#: Numbers of one draw of a variable, up to which its sensitivities are found.
MOST_INDICES = 12
#: Maximum width of the interval of a total index without a warning.
WIDE = 0.1

_INTERVAL = "half the width of the 95 % interval of the {}"
#: Statistics of each variable: ending of the name, additional dimension, words, and True without a unit.
_STATISTICS: dict[str, tuple[str, str, bool]] = {
    "sample_mean": ("", "mean over the draws of the {}", False),
    "sample_standard_deviation": ("", "sample standard deviation over the draws of the {}", False),
    "sample_standard_error": ("", "standard error of the mean over the draws of the {}", False),
    "sample_percentile": (PERCENTILE, "percentiles over the draws of the {}", False),
}
_SENSITIVITIES: dict[str, dict[str, tuple[str, str, bool]]] = {
    SOBOL: {
        "first_order_index": (PARAMETER, "part of the variance of the {} that each parameter explains by itself", True),
        "first_order_interval": (PARAMETER, _INTERVAL.format("first-order index of the {}"), True),
        "total_index": (PARAMETER, "part of the variance of the {} that each parameter has a share in", True),
        "total_interval": (PARAMETER, _INTERVAL.format("total index of the {}"), True),
    },
    MORRIS: {
        "effect_mean": (PARAMETER, "mean elementary effect of each parameter on the {}", False),
        "effect_mean_magnitude": (PARAMETER, "mean magnitude of the elementary effects on the {}", False),
        "effect_standard_deviation": (PARAMETER, "standard deviation of the elementary effects on the {}", False),
    },
    LOCAL: {
        "change_down": (PARAMETER, "change of the {} with one standard normal deviate less of each parameter", False),
        "change_up": (PARAMETER, "change of the {} with one standard normal deviate more of each parameter", False),
    },
}
_EFFECT = "change as the parameter goes from its 12.5 to its 87.5 % quantile"


class Sampled(Family):
    """A family with a dimension ``sample``: computed by `inner`, one draw after the other.

    Variables that `inner` computes or finishes for a draw are computed variables here; statistics are finished
    variables.
    """

    def __init__(self, inner: Family) -> None:
        self.inner = inner
        self.name, self.title = inner.name, inner.title
        self.references, self.keywords = inner.references, inner.keywords
        self.headlines = tuple(f"{name}_sample_mean" for name in inner.headlines)

    def study_class(self) -> type[Study]:
        """Return the model of the family."""
        return self.inner.study_class()

    def workload(self, study: Any) -> Workload:
        """Return the workload of all draws; points are not split. Raises StudyError if names clash."""
        work = self.inner.workload(study)
        own = [*work.inner, *(name for name in work.parameters if name != SAMPLE)]
        for dim in (dim for dim in (*self._sizes(study), SAMPLE) if dim in own):
            raise StudyError(
                study.problem("sample", f"the result has a dimension {dim!r} of its own, and no room for one of draws")
            )
        length = work.inner.get(work.splittable, 1)
        return replace(
            work,
            inner={**work.inner, **self._sizes(study)},
            splittable="",
            whole=(*work.whole, SAMPLE),
            uncut=work.whole,
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
        """Return the variables of each draw with their statistics; variables of large results are `passing`."""
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
            if large and not statistical and not sample.statistics.every_draw:
                continue
            passing = large and not sample.statistics.every_draw
            found[name] = replace(one, dims=(*others, SAMPLE), finished=False, passing=passing)
            made = dict(statistical)
            if design.sensitivity and not large and numbers <= MOST_INDICES:
                made |= _SENSITIVITIES[design.sensitivity]
            for ending, (dim, words, pure) in made.items():
                attrs = _attributes(one, words, pure)
                found[f"{name}_{ending}"] = Variable((*others, *([dim] if dim else [])), attrs, finished=True)
        return found

    def coordinates(self, study: Any) -> xr.Dataset:
        """Return the coordinates of the family, names of parameters, and percentiles; the draws are attributes."""
        labels = self.inner.coordinates(study)
        sizes, sample = self._sizes(study), study.sample
        if not sample.statistics.every_draw:  # places of heliostats that no stored variable has
            labels = labels.drop_vars(
                [name for name, one in labels.coords.items() if SAMPLE in one.dims and one.ndim > 1]
            )
        if PERCENTILE in sizes:
            attrs = {"long_name": "percentile of the draws", "units": "percent"}
            labels = labels.assign_coords({PERCENTILE: (PERCENTILE, sample.statistics.percentiles.values(), attrs)})
        if PARAMETER in sizes:
            attrs = {"long_name": "drawn key, or group of keys"}
            names = np.array(parameter_names(study), dtype=object)
            labels = labels.assign_coords({PARAMETER: (PARAMETER, names, attrs)})
        return labels.assign_attrs(sample_design=_words(study))

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Compile or load the kernels of the family."""
        return self.inner.prepare(study)

    def inputs(self, study: Any) -> Any:
        """Read the files of the family."""
        return self.inner.inputs(study)

    def compute(self, study: Any, inputs: Any, region: Region) -> xr.Dataset:
        """Return the variables that the family computes and finishes for the draws of a region."""
        computed = self.inner.compute(study, inputs, region)
        if any(one.finished for one in self.inner.variables(study).values()):
            computed = computed.assign(self.inner.finish(study, inputs, region, computed).data_vars)
        return computed

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        """Return statistics over all draws of some variables."""
        import xarray as xr

        design, made = design_of(study), dict[str, Any]()
        percentiles = study.sample.statistics.percentiles.values()
        wanted = self.variables(study)
        for name, array in computed.data_vars.items():
            if SAMPLE not in array.dims or array.dtype.kind != "f":
                continue
            values = np.ascontiguousarray(array.transpose(..., SAMPLE).to_numpy())
            results: list[np.ndarray] = []
            if statistics.has_statistics(design):
                results += [*statistics.mean_of_draws(values, design)]
                results.append(statistics.percentiles_of_draws(values, percentiles, design))
            names = [f"{name}_{ending}" for ending in _STATISTICS][: len(results)]
            of = _SENSITIVITIES.get(design.sensitivity, {})
            if of and f"{name}_{next(iter(of))}" in wanted:
                names += [f"{name}_{ending}" for ending in of]
                results += _sensitivity(values, design)
            made |= {each: (wanted[each].dims, values) for each, values in zip(names, results, strict=True)}
        return xr.Dataset(made)

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Yield a remark on total indices with wide intervals."""
        for name, array in result.data_vars.items():
            if str(name).endswith("_total_interval"):
                wide = float(2 * array.max())
                if wide > WIDE:
                    what = str(name).removesuffix("_total_interval")
                    yield f"{what}: an interval of its total indices is {wide:.3f} wide, more than {WIDE}: draw more"

    def figures(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return figures of the distributions of the results and of the sensitivities."""
        from heliosweep.report.draws import figures

        return figures(result, self.inner.headlines)

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Statistics of each result, and indices of each key."""
        from heliosweep.report.draws import tables

        return tables(result, self.inner.headlines)


def _sensitivity(values: np.ndarray, design: Any) -> Iterator[np.ndarray]:
    if design.sensitivity == SOBOL:
        return iter(statistics.sobol_indices(values, design))
    if design.sensitivity == MORRIS:
        return iter(statistics.elementary_effects(values, design))
    return iter(statistics.single_steps(values))


def _attributes(one: Variable, words: str, pure: bool) -> dict[str, Any]:
    """CF attributes of a statistic of a variable."""
    attrs = {"units": "1" if pure else one.attrs.get("units", "1")}
    attrs["long_name"] = words.format(one.attrs.get("long_name", "result"))
    if "elementary" in words:
        attrs["comment"] = _EFFECT
    for name in ("cell_methods", "valid_range"):
        if name in one.attrs and words in {known for _, known, _ in _STATISTICS.values()}:
            attrs[name] = one.attrs[name]
    if BEST_VALUE in one.attrs and words.startswith(("mean over the draws", "percentiles")):
        attrs[BEST_VALUE] = one.attrs[BEST_VALUE]
    return attrs


def _words(study: Study) -> str:
    """Describe the draws, and the method of the errors of means and the intervals of indices."""
    design = design_of(study)
    if design.sensitivity == LOCAL:
        return "the median of all keys, and of each parameter one standard normal deviate down and up"
    if design.sensitivity == MORRIS:
        return f"{design.size} trajectories of elementary effects, four levels from the 12.5 to the 87.5 % quantile"
    what = {
        SOBOL: f"{REPLICATES} Sobol sequences, scrambled independently, draw k of sequence k modulo {REPLICATES}; "
        "standard errors refer to the mean of this number of means",
        RANDOM: "independent draws; standard errors from their deviation",
    }.get(design.kind, "Latin hypercube; standard errors as of independent draws, which is more than they are")
    if design.sensitivity != SOBOL:
        return what
    how = f"Student's about a jackknife over the {REPLICATES} sequences" if design.kind == SOBOL else "by bootstrap"
    return f"design of Saltelli on {what}; 95 % intervals of indices {how}"
