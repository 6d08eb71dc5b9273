"""Energy from a heliostat field, losses at each stage, sums over periods, and atmospheric attenuation.

All functions accept arrays and require no study. Energies are in MWh, and irradiation is in MWh m-2. The efficiency of
a stage is the fraction of the incoming light that remains after the stage.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.compiled import Floats, Integers
from heliosweep.lazy import xr

#: Conversion factor from irradiance times hours [W h m-2] to irradiation [MWh m-2].
MEGA = 1e-6
#: Last part of an error budget: the loss due to all causes minus the sum of the losses due to each cause alone.
INTERACTION = "interaction"
#: Transmittance as a function of the slant range r [km], for each attenuation model.
_FORMULAS: dict[str, Callable[[Floats], Floats]] = {
    "none": np.ones_like,
    "delsol_clear": lambda r: 1 - (0.006789 + 0.1046 * r - 0.017 * r**2 + 0.002845 * r**3),
    "delsol_hazy": lambda r: 1 - (0.01293 + 0.2748 * r - 0.03394 * r**2),
    "leary_hankins": lambda r: np.where(r <= 1, 0.99321 - 0.1176 * r + 0.0197 * r**2, np.exp(-0.1106 * r)),
    "ballestrin_clear": lambda r: 1 - (0.29544 + 15.22128 * r - 1.8598 * r**2 + 0.15182 * r**3) / 100,
    "ballestrin_hazy": lambda r: 1 - (0.77941 + 55.49083 * r - 14.78875 * r**2 + 1.53718 * r**3) / 100,
}


def transmittance(
    slant_range: ArrayLike, model: str = "delsol_clear", *, visibility: float = 23e3, water_vapour: float = 5.9,
    altitude: float = 0.0, receiver_height: float = 100.0,
) -> Any:  # fmt: skip
    """Compute the transmittance of the air between a mirror and the receiver.

    Parameters
    ----------
    slant_range : float, array or DataArray
        Distance from the mirror to the receiver. [m]
    model : str
        Attenuation model: 'none', 'delsol_clear' or 'delsol_hazy' (Kistler 1986), 'leary_hankins' (Leary and Hankins
        1979), 'ballestrin_clear' or 'ballestrin_hazy' (Ballestrin and Marzo 2012), or 'vant_hull' (Vant-Hull's model
        as implemented in open-source ray tracers). Only 'vant_hull' uses the parameters below.
    visibility : float
        Meteorological visibility. [m]
    water_vapour : float
        Density of water vapour in the air. [g m-3]
    altitude : float
        Altitude of the site. [m]
    receiver_height : float
        Height of the receiver above the ground. [m]

    Returns
    -------
    float, array or DataArray
        Fraction of the light that the air transmits, between 0 and 1. [1]

    Raises
    ------
    ValueError
        If the model is unknown.

    References
    ----------
    Kistler (1986), A user's manual for DELSOL3, SAND86-8018. Leary and Hankins (1979), A user's guide for MIRVAL,
    SAND77-8280. Ballestrin and Marzo (2012), Solar radiation attenuation in solar tower plants, Solar Energy 86,
    388-392.

    Examples
    --------
    >>> import heliosweep
    >>> round(heliosweep.transmittance(1000.0, "delsol_clear"), 4)
    0.9028
    """
    if model != "vant_hull" and model not in _FORMULAS:
        raise ValueError(f"`model` must be one of {', '.join(_FORMULAS)}, vant_hull (got {model!r})")
    far = np.asarray(slant_range, np.float64) / 1000.0
    if model == "vant_hull":  # extinction by water vapour, and by dust whose density decreases with height
        extinction = 3.912 / (visibility / 1000)
        thinning = (0.0112 * altitude / 1000 + 0.0822) * math.log((extinction + 0.0003 * water_vapour) / 0.00455)
        power = 1 - (0.00101 * water_vapour + 0.0507) / math.sqrt(extinction + 0.0091)
        strength = (0.0105 * water_vapour + 0.724) * (extinction - 0.0037) ** power
        passed = np.exp(-strength * math.exp(-thinning * receiver_height / 1000) * far**power)
    else:
        passed = _FORMULAS[model](far)
    return _like(slant_range, np.clip(passed, 0.0, 1.0))


def energy_losses(incident: ArrayLike, left: Sequence[ArrayLike]) -> Floats:
    """Return the energy lost at each stage of a chain of efficiencies.

    Parameters
    ----------
    incident : float or array
        Energy before the first stage, in any unit.
    left : sequence of float or array
        Energy that remains after each stage, in the order in which light passes through the stages.

    Returns
    -------
    ndarray, shape (stages, ...)
        Loss at each stage, in the unit of the energies. The sum of the losses is the incident energy minus the energy
        after the last stage.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.energy_losses(10.0, [8.0, 7.5, 7.0]).tolist()
    [2.0, 0.5, 0.5]
    """
    steps = np.stack(np.broadcast_arrays(incident, *left))
    return steps[:-1] - steps[1:]


def error_budget(
    undisturbed: ArrayLike, actual: ArrayLike, alone: Mapping[str, ArrayLike],
    without: Mapping[str, ArrayLike] | None = None,
) -> xr.Dataset:  # fmt: skip
    """Split an energy loss into the contributions of each cause and of their interaction.

    Parameters
    ----------
    undisturbed, actual : float or array, shape (...)
        Energy without any cause of loss, and energy with all causes. [MWh]
    alone : mapping of str to float or array, shape (...)
        Energy with only the named cause. [MWh]
    without : mapping of str to float or array, shape (...), optional
        Energy with all causes except the named cause. [MWh]

    Returns
    -------
    xarray.Dataset
        The variable `loss`, with the ``part`` dimension, contains the loss due to each cause alone. The last part,
        'interaction', is the remaining loss. The sum of all parts is the undisturbed energy minus the actual energy. If
        `without` is given, the variable `gain`, with the ``cause`` dimension, contains the energy gained by removing
        each cause. [MWh]

    Raises
    ------
    ValueError
        If there is no cause, if a cause is named 'interaction', or if `alone` and `without` have different causes.

    Examples
    --------
    >>> import heliosweep
    >>> alone = {"soiling": 96.0, "slopes": 90.0}
    >>> budget = heliosweep.error_budget(100.0, 87.0, alone, without={"soiling": 90.5, "slopes": 96.0})
    >>> dict(zip(budget.part.values.tolist(), budget.loss.values.tolist()))
    {'soiling': 4.0, 'slopes': 10.0, 'interaction': -1.0}
    >>> budget.gain.values.tolist()
    [3.5, 9.0]
    """
    causes = list(alone)
    if not causes or INTERACTION in causes or (without is not None and set(without) != set(causes)):
        raise ValueError(
            f"`alone` and `without` must have the same causes (at least one, and none named {INTERACTION!r})"
        )
    single = np.stack(np.broadcast_arrays(*alone.values()), axis=-1)
    energy, reached = (np.asarray(one, np.float64)[..., np.newaxis] for one in (undisturbed, actual))
    parts = energy - single
    loss = np.concatenate((parts, energy - reached - parts.sum(axis=-1, keepdims=True)), axis=-1)
    outer, units = [f"point_{k}" for k in range(loss.ndim - 1)], {"units": "MWh"}
    made = {"loss": ((*outer, "part"), loss, units | {"long_name": "energy lost to each cause alone"})}
    if without is not None:
        removed = np.stack(np.broadcast_arrays(*(without[cause] for cause in causes)), axis=-1)
        gain = removed - reached
        made["gain"] = (*outer, "cause"), gain, units | {"long_name": "energy gained if only this cause is removed"}
    return xr.Dataset(made, {"part": [*causes, INTERACTION], **({"cause": causes} if without is not None else {})})


def monthly_sums(values: Floats, month: Integers, months: int = 12) -> Floats:
    """Sum values over the instants in each month.

    Parameters
    ----------
    values : ndarray, shape (T,) or (T, N)
        Values at T instants.
    month : ndarray of int, shape (T,)
        Month of each instant, numbered from 0.
    months : int
        Number of months.

    Returns
    -------
    ndarray, shape (months,) or (months, N)

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.monthly_sums([1.0, 2.0, 4.0], [0, 0, 11]).tolist()[:2]
    [3.0, 0.0]
    """
    values = np.asarray(values, np.float64)
    columns = [
        np.bincount(month, column, months) for column in values.reshape(len(values), math.prod(values.shape[1:])).T
    ]
    return np.stack(columns, axis=-1).reshape(months, *values.shape[1:]).astype(np.float64)


def availability(
    start: ArrayLike, hours: ArrayLike, begin: ArrayLike, end: ArrayLike, *, yearly: bool = False
) -> Floats:  # fmt: skip
    """Compute the fraction of each time interval without an outage.

    Parameters
    ----------
    start : array of datetime64, shape (T,)
        Start of each time interval.
    hours : float or array, shape (T,)
        Length of each interval, less than one day. [h]
    begin, end : array of datetime64, shape (n,)
        Start and end of each outage.
    yearly : bool
        If True, outages recur every year, and the year of each date is ignored, for use with a typical year. An outage
        whose end has an earlier calendar date than its start then extends into the next year.

    Returns
    -------
    ndarray, shape (T,)
        Available fraction of each interval, for use as the efficiency of a stage in `annual_energy`. [1]

    Raises
    ------
    ValueError
        If the shapes do not match, if an outage ends before its start, or if outages overlap.

    Examples
    --------
    >>> import heliosweep
    >>> hours = ["2021-06-01T10:00", "2021-06-01T11:00", "2021-06-01T12:00"]
    >>> heliosweep.availability(hours, 1.0, ["2021-06-01T11:15"], ["2021-06-02"]).tolist()
    [1.0, 0.25, 0.0]
    """
    times, first, last = (np.array(each, "datetime64[s]", ndmin=1) for each in (start, begin, end))
    if first.shape != last.shape or (last <= first).any():
        raise ValueError("`end` must have the same shape as `begin`, and each outage must end after its start")
    turn = np.timedelta64(0, "s")
    if yearly:
        whole, turn = last - first >= np.timedelta64(365, "D"), np.timedelta64(366, "D")
        months = (each.astype("datetime64[M]") for each in (times, first, last))
        times, first, last = (  # in the leap year 2000
            (np.datetime64("2000-01") + month.astype(np.int64) % 12).astype("datetime64[s]") + (each - month)
            for each, month in zip((times, first, last), months, strict=True)
        )
        last = np.where(whole, first + turn, np.where(last < first, last + turn, last))
    order = np.argsort(first)
    if (first[order][1:] < last[order][:-1]).any() or (yearly and len(first) and last.max() - turn > first.min()):
        raise ValueError("outages must not overlap; join them")
    seconds = np.broadcast_to(3600.0 * np.asarray(hours, np.float64), times.shape)
    out = np.zeros(times.shape)
    for back in (turn, 0 * turn) if yearly else (turn,):
        low, high = ((times[:, np.newaxis] - each + back).astype(np.float64) for each in (last, first))
        out += np.maximum(np.minimum(-low, seconds[:, np.newaxis]) - np.maximum(-high, 0.0), 0.0).sum(axis=1)
    return 1.0 - out / np.where(seconds > 0.0, seconds, 1.0)


def exceedance(values: Any, probability: ArrayLike = (0.5, 0.9), dim: str = "weather") -> Any:
    """Compute exceedance values of annual results, such as P50 and P90.

    The values are linearly interpolated quantiles of the annual results; no distribution is fitted.

    Parameters
    ----------
    values : array or DataArray, shape (..., years)
        Annual results, such as the energy in each weather year.
    probability : float or array, shape (n,)
        Exceedance probabilities, between 0 and 1. [1]
    dim : str
        Name of the year dimension if `values` is a DataArray.

    Returns
    -------
    ndarray, shape (..., n), or DataArray
        Values that the annual results exceed with each probability. In a DataArray, the ``exceedance`` dimension
        replaces the year dimension.

    Raises
    ------
    ValueError
        If a probability is not between 0 and 1.

    References
    ----------
    Dobos, Gilman and Kasberg (2012), P50/P90 analysis for solar energy systems using the System Advisor Model,
    NREL/CP-6A20-54488.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.exceedance([90.0, 100.0, 110.0, 120.0, 130.0], [0.5, 0.9]).tolist()
    [110.0, 94.0]
    """
    part = np.asarray(probability, np.float64)
    if hasattr(values, "coords"):
        found = values.quantile(1.0 - part, dim, keep_attrs=True).assign_coords(quantile=part)
        return found.rename(quantile="exceedance").transpose(..., *(["exceedance"] if part.ndim else []))
    found = np.quantile(np.asarray(values, np.float64), 1.0 - part, axis=-1)
    return np.moveaxis(found, 0, -1) if part.ndim else found


def annual_energy(
    dni: ArrayLike, hours: ArrayLike, efficiencies: Mapping[str, ArrayLike], area: ArrayLike = 1.0, *,
    month: ArrayLike | None = None, works: ArrayLike = True,
) -> xr.Dataset:  # fmt: skip
    """Compute the energy on the receiver over a period, and the losses at each stage.

    The energy that a heliostat delivers to the receiver is

        E = area * sum of dni * hours * product of the efficiencies.

    The sum extends over all instants at which the field operates.

    Parameters
    ----------
    dni : array or DataArray, shape (T,)
        Direct normal irradiance; 0 if the sun is below the horizon. [W m-2]
    hours : float or array, shape (T,)
        Length of the time interval that each instant represents. [h]
    efficiencies : mapping of str to float or array, shape (), (T,), (1, N) or (T, N)
        Efficiency of each stage, in the order in which light passes through the stages. Typical stages are cosine,
        shading and blocking, reflection, attenuation and intercept. NaN is treated as 0. [1]
    area : float or array, shape (N,)
        Mirror area of each heliostat. [m2]
    month : array of int, shape (T,), optional
        Month of each instant, from 1 to 12, for monthly sums.
    works : bool or array, shape (T,)
        False when the field does not operate, for example in strong wind.

    Returns
    -------
    xarray.Dataset
        Variables `incident_energy` and `receiver_energy` for each heliostat, `loss` for each stage (beginning with
        'stow') and heliostat, `field_energy`, and, if `month` is given, `monthly_receiver_energy`. [MWh]

    Raises
    ------
    ValueError
        If the shapes do not match, or if an irradiance is negative or not finite.

    Examples
    --------
    >>> import heliosweep
    >>> chain = {"cosine": [[0.8], [0.9]], "reflection": 0.9, "intercept": [[0.95], [0.97]]}
    >>> year = heliosweep.annual_energy([800.0, 900.0], 1.0, chain, area=100.0)
    >>> round(float(year.field_energy), 4), year.stage.values.tolist()
    (0.1254, ['stow', 'cosine', 'reflection', 'intercept'])
    """
    irradiance = np.asarray(dni, np.float64)
    if irradiance.ndim != 1 or not (np.isfinite(irradiance) & (irradiance >= 0.0)).all():
        raise ValueError(
            "`dni` must have the shape (T,) and contain finite values of at least 0; set missing hours to 0"
        )
    energy = (irradiance * np.asarray(hours, np.float64) * MEGA)[:, np.newaxis]
    mirrors = np.atleast_1d(np.asarray(area, np.float64))
    rest, left = np.where(np.asarray(works)[..., np.newaxis], energy, 0.0), []
    for name, value in {"stow": 1.0, **efficiencies}.items():
        part = np.nan_to_num(np.asarray(value, np.float64))
        try:
            rest = rest * (part[:, np.newaxis] if part.ndim == 1 else part)
            left.append(mirrors * rest.sum(axis=0))
        except ValueError:
            raise ValueError(f"`efficiencies`: {name} must have the shape (T,), (1, N) or (T, N) (got {part.shape})") \
                from None  # fmt: skip
    incident = np.broadcast_to(mirrors * energy.sum(), left[-1].shape)
    found = {
        "incident_energy": ("heliostat", incident, "direct normal irradiation times the mirror area"),
        "receiver_energy": ("heliostat", left[-1], "energy on the receiver"),
        "loss": (("stage", "heliostat"), energy_losses(incident, left), "energy lost at each stage"),
        "field_energy": ((), left[-1].sum(), "energy from all heliostats on the receiver"),
    }
    if month is not None:
        monthly = mirrors * monthly_sums(rest, np.asarray(month, np.int64) - 1)
        found["monthly_receiver_energy"] = ("month", "heliostat"), monthly, "energy on the receiver in each month"
    labels = {"stage": ["stow", *efficiencies]} | ({} if month is None else {"month": np.arange(1, 13)})
    units = {"units": "MWh"}
    return xr.Dataset({name: (*pair, units | {"long_name": words}) for name, (*pair, words) in found.items()}, labels)


def receiver_heat(
    power: ArrayLike, absorptance: ArrayLike = 1.0, losses: ArrayLike = 0.0, *, table: ArrayLike | None = None
) -> Any:
    """Compute the heat that a receiver transfers to its fluid.

        heat = max(absorptance * power - losses, 0)

    The receiver does not operate if its losses exceed the absorbed power.

    Parameters
    ----------
    power : float, array or DataArray
        Power of the light on the receiver, in MW or any other unit.
    absorptance : float, array or DataArray
        Fraction of the light that the receiver absorbs, from 0 to 1. [1]
    losses : float, array or DataArray
        Thermal losses of the operating receiver, in the unit of the power. Multiply losses per unit area by the area.
    table : array, shape (2, n), optional
        Powers in ascending order, and additional losses at these powers. The losses are interpolated linearly, and are
        constant beyond the ends of the table.

    Returns
    -------
    float, array or DataArray
        Heat transferred to the fluid of the receiver, in the unit of the power; NaN for missing power.

    Raises
    ------
    ValueError
        If a value is negative, an absorptance is above 1, or the powers in the table are not in ascending order.

    References
    ----------
    SAM technical manual for molten-salt power towers, NREL/TP-5500-57625 (2013), Sect. 4. The manual computes the
    radiative and convective losses of an external receiver from the tube temperatures. The parameter `losses` is the
    sum of these losses.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.receiver_heat([0.0, 2.0, 50.0], 0.94, 0.03 * 100.0).tolist()
    [0.0, 0.0, 44.0]
    """
    further: Any = 0.0
    if table is not None:
        powers, lost = np.asarray(table, np.float64)
        if not (np.diff(powers) > 0).all():
            raise ValueError("`table` must have powers in ascending order")
        further = _like(power, np.interp(np.asarray(power, np.float64), powers, lost))
    for name, value, most in (("power", power, np.inf), ("absorptance", absorptance, 1.0), ("losses", losses, np.inf)):
        if (np.asarray(value) < 0.0).any() or (np.asarray(value) > most).any():
            raise ValueError(f"`{name}` must be at least 0" + (" and at most 1" if most == 1.0 else ""))
    given: list[Any] = [power, absorptance, losses]
    light, part, lost = (value if hasattr(value, "dims") else np.asarray(value, np.float64) for value in given)
    heat = (part * light - lost - further).clip(0.0)
    return heat if np.ndim(heat) or hasattr(heat, "dims") else float(heat)


def _like(given: Any, values: Floats) -> Any:
    """Return values as a float, an array or a DataArray, according to the type of `given`."""
    if hasattr(given, "coords"):
        return given.copy(data=values)
    return values if isinstance(given, np.ndarray | list | tuple) else float(values)
