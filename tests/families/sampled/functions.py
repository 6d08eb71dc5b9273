"""Families of test functions with known indices, and one whose result is a weighted sum."""

from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.blocks import Block
from heliosweep.config.study import Study
from heliosweep.config.values import Quantity, Sweep
from heliosweep.families.family import Family
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import Region, Variable

#: Ishigami and Homma (1990): y = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1, on -pi to pi. Variances of its parts by hand.
_A, _B = 7.0, 0.1
_FIRST = np.array([0.5 * (1 + _B * np.pi**4 / 5) ** 2, _A**2 / 8, 0.0])
_THIRD = _B**2 * np.pi**8 * (1 / 18 - 1 / 50)
_VARIANCE = _FIRST.sum() + _THIRD
ISHIGAMI = _FIRST / _VARIANCE, (_FIRST + np.array([_THIRD, 0, _THIRD])) / _VARIANCE

#: Saltelli and Sobol (1995): y = product of (|4 x - 2| + a) / (1 + a), on 0 to 1.
WEIGHTS = np.array([0.0, 1.0, 4.5, 9.0])
_PART = 1 / (3 * (1 + WEIGHTS) ** 2)
_WHOLE = np.prod(1 + _PART) - 1
G_FUNCTION = _PART / _WHOLE, np.array([one * np.prod(1 + np.delete(_PART, k)) for k, one in enumerate(_PART)]) / _WHOLE


def ishigami(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ishigami's function of angles, shape (..., 3)."""
    return np.sin(x[..., 0]) * (1 + _B * x[..., 2] ** 4) + _A * np.sin(x[..., 1]) ** 2


def g_function(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sobol's g-function, shape (..., 4)."""
    return np.prod((np.abs(4 * x - 2) + WEIGHTS) / (1 + WEIGHTS), axis=-1)


Number = Annotated[float | Sweep, Quantity("a number", "1", ge=-100, le=100)]


class Inputs(Block):
    x1: Number = 0.0
    x2: Number = 0.0
    x3: Number = 0.0
    x4: Number = 0.0


class FunctionStudy(Study):
    family: Literal["functions"]
    inputs: Inputs = Inputs()
    scale: Number = 1.0


class Functions(Family):
    """`value` is Ishigami's function, `product` the g-function, `total` a sum; `heliostat` has 1000 multiples of it."""

    calls = 0

    def __init__(self) -> None:
        super().__init__("functions", "Test functions", FunctionStudy, None, example="")

    def workload(self, study: Any) -> Workload:
        return Workload(
            parameters=Parameters(study).sizes, inner={"heliostat": 1000, "month": 3}, evaluations=1, unit="points",
            working_bytes=lambda points, _: 100 * points, splittable="heliostat",
        )  # fmt: skip

    def variables(self, study: Any) -> dict[str, Variable]:
        dims = tuple(Parameters(study).sizes)

        def attrs(name: str) -> dict[str, str]:
            return {"units": "m", "long_name": name}

        return {
            "each": Variable((*dims, "heliostat"), attrs("multiple of the sum")),
            "monthly": Variable((*dims, "month", "heliostat"), attrs("multiple in each month")),
            "value": Variable(dims, attrs("function of Ishigami"), finished=True),
            "product": Variable(dims, attrs("g-function"), finished=True),
            "total": Variable(dims, attrs("weighted sum") | {"best_value": "largest"}, finished=True),
            "constant": Variable(dims, attrs("constant"), finished=True),
        }

    def coordinates(self, study: Any) -> xr.Dataset:
        return xr.Dataset(coords=Parameters(study).coordinates())

    def _inputs(self, study: Any, region: Region) -> tuple[Any, NDArray[np.float64]]:
        parameters = Parameters(study, region)
        inputs: Any = [parameters.values(f"inputs.x{k}") for k in (1, 2, 3, 4)]
        return parameters.values("scale"), np.stack(inputs, axis=-1)

    def inputs(self, study: Any) -> Any:
        return None

    def prepare(self, study: Any) -> tuple[float, bool]:
        return 0.0, False

    def compute(self, study: Any, inputs: Any, region: Region) -> xr.Dataset:
        scale, x = self._inputs(study, region)
        Functions.calls += scale.size
        multiples = np.arange(1000)[region.get("heliostat", slice(None))]
        dims = (*Parameters(study).sizes, "heliostat")
        each = (scale * total(x))[..., np.newaxis] * multiples
        monthly = each[..., np.newaxis, :] * np.arange(1.0, 4.0)[:, np.newaxis]
        return xr.Dataset({"each": (dims, each), "monthly": ((*dims[:-1], "month", "heliostat"), monthly)})

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        scale, x = self._inputs(study, region)
        made = {
            "value": ishigami(x[..., :3]), "product": g_function(x), "total": total(x), "constant": x[..., 0] * 0 + 3,
        }  # fmt: skip
        return xr.Dataset({name: (tuple(Parameters(study).sizes), scale * y) for name, y in made.items()})

    def remarks(self, result: xr.Dataset) -> tuple[str, ...]:
        return ()


def total(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted sum of the inputs."""
    return x[..., 0] + 2 * x[..., 1] - 3 * x[..., 2]
