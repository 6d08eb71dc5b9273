"""Draw special figures of a field with matplotlib. Each public function draws the figure with the same name."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.colors import Normalize
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke

from heliosweep.families.field_efficiency.optics import DIMS
from heliosweep.report.draw import colour_bar, label_outside, legend, panels
from heliosweep.report.figures import COLOURS, HELIOSTAT, VALUES, Context, at, fold


def _bars(
    context: Context, points: Sequence[Mapping[str, int]], steps: Sequence[str], height: float, xlabel: str,
    draw: Callable[[Any, Any], None],
) -> Any:  # fmt: skip
    """Draw one panel of horizontal bars for each point. `draw` adds one bar for each step to a panel."""
    drawing, grid = panels(len(points), 2, height * len(steps), wide=True, sharex=True, sharey=True)
    for axes, point in zip(grid, points, strict=True):
        draw(axes, point)
        axes.set(title=fold(context.fulls(point), 55), yticks=range(len(steps)), yticklabels=steps, xlabel=xlabel)
        axes.grid(True, axis="x")
    grid[0].set_ylim(len(steps) - 0.5, -0.5)
    label_outside(grid, 2)
    return drawing


def _waterfall(axes: Any, whole: float, lost: Any, rest: float, colours: Sequence[str]) -> None:
    """Draw bars for the total energy, each loss and the remaining energy, labelled with amounts and percentages."""
    lengths, starts = np.array([whole, *lost, rest]), np.array([0.0, *(whole - np.cumsum(lost)), 0.0])
    last, gap = len(lengths) - 1, 0.02 * whole
    axes.barh(range(len(lengths)), lengths, left=starts, color=colours, height=0.72)
    for row, (length, start) in enumerate(zip(lengths, starts, strict=True)):
        share = 100 * length / whole if whole else np.nan
        amount = f"{length:,.0f}" if abs(length) >= 1000 else f"{length:.3g}"
        inside = row in (0, last)
        left = inside or start < 0.4 * whole
        axes.text(
            gap if inside else start + length + gap if left else start - gap, row,
            f"{amount} ({share:.{2 if 0 < share < 0.1 else 1}f} %)", ha="left" if left else "right", va="center",
            fontsize=7, color="white" if row == last else "black",
        )  # fmt: skip


def energy_losses(result: xr.Dataset) -> Any:
    """Draw waterfall charts of the energy losses at selected points."""
    context, received = Context(result), result["field_receiver_energy"]
    dims = [dim for dim in received.dims if received.sizes[dim] > 1]
    dim = str(next((one for one in ("latitude", "site", "layout", *dims) if one in dims), ""))
    other = "tracking" if "tracking" in dims and dim != "tracking" else None
    fixed = context.fixed(received, dim, other)
    points = [{**p, **q} for p in context.chosen(dim, 4 if not other else 2) for q in context.chosen(other, 2)]
    happens = (result["loss"] != 0).any([one for one in result["loss"].dims if one != "stage"]).to_numpy()
    stages = [str(stage).replace("_", " ") for stage in result["stage"].to_numpy()[happens]]
    stages = ["stow (limits)" if stage == "stow" else stage for stage in stages]
    heat, end = "field_heat" in result, "on the receiver" if "total_efficiency" in result else "sent to the receiver"
    steps = ["incident", *stages, "heat" if heat else end]
    colours = ["#b0b0b0", *[COLOURS[1]] * len(stages), COLOURS[0]]

    def waterfall(axes: Any, point: Any) -> None:
        lost = at(result["loss"], fixed, point).to_numpy()[happens]
        whole = float(at(result["field_incident_energy"], fixed, point))
        rest = float(at(result["field_heat" if heat else "field_receiver_energy"], fixed, point))
        _waterfall(axes, whole, lost, rest, colours)

    return _bars(context, points, steps, 0.06, "energy (MWh)", waterfall), context.note(fixed)


def error_budget(result: xr.Dataset) -> Any:
    """Draw waterfall charts of the loss due to each cause at selected points.

    If the result has draws, the bars show means over the draws, and the error bars show standard deviations.
    """
    mean = "_sample_mean" * ("budget_loss_sample_mean" in result)
    context, energy = Context(result), result[f"budget_energy{mean}"]
    dim = next((str(one) for one in energy.dims if energy.sizes[one] > 1), "")
    fixed, points = context.fixed(energy, dim), context.chosen(dim, 4)
    rest = ["spillage without causes"] * ("spillage" in result["stage"].to_numpy())
    parts = [*rest, *map(str, result["budget_part"].to_numpy()), "all causes"]
    shown = {"loss": f"loss{mean}", "gain": f"gain{mean}", "spread": "loss_sample_standard_deviation"}

    def waterfall(axes: Any, point: Any) -> None:
        values = {name: 100 * at(result[f"budget_{of}"] / energy, fixed, point).to_numpy()
                  for name, of in shown.items() if f"budget_{of}" in result}  # fmt: skip
        lost, spread = values["loss"], values.get("spread", np.zeros(len(parts) - len(rest) - 1))
        spilled = [100 * float(at(result[f"budget_stage_loss{mean}"].sel(stage=name.split()[0]) / energy, fixed, point))
                   for name in rest]  # fmt: skip
        lengths = np.concatenate((spilled, lost, [lost.sum()]))
        starts = np.cumsum(lengths) - lengths
        starts[-1] = sum(spilled)
        spread = np.concatenate((np.zeros(len(rest)), spread, [0.0]))
        axes.barh(range(len(parts)), lengths, left=starts, height=0.6,
                  color=[*["#999999"] * len(rest), *[COLOURS[1]] * len(lost), COLOURS[0]])  # fmt: skip
        if mean:
            axes.errorbar(starts + lengths, range(len(parts)), xerr=np.where(spread > 0.0, spread, np.nan), fmt="none",
                          ecolor="black", capsize=2)  # fmt: skip
        gains = [*[""] * len(rest), *(f" (gain {more:.2f} %)" for more in values["gain"]), "", ""]
        ends = starts + np.maximum(lengths, 0.0) + spread
        for row, (length, one, gain, end) in enumerate(zip(lengths, spread, gains, ends, strict=True)):
            word = f"{length:.2f}{f' ± {one:.2f}' * bool(one)} %{gain}"
            axes.annotate(word, (end, row), (4, 0), textcoords="offset points", va="center", fontsize=7)
        axes.margins(x=0.5)

    label = "energy lost (% of the energy without the causes)"
    notes = ["Gain: energy gained if only this cause is removed.",
             "Error bars: standard deviation over the draws." * bool(mean), context.note(fixed)]  # fmt: skip
    return _bars(context, points, parts, 0.08, label, waterfall), " ".join(filter(None, notes))


def capital_cost(result: xr.Dataset) -> Any:
    """Draw stacked bars of the capital cost by item at selected points."""
    context, cost = Context(result), result["capital_cost"]
    dims = [*(str(dim) for dim in cost.dims if dim != "item" and cost.sizes[dim] > 1), None, None][:2]
    fixed = context.fixed(cost, "item", *dims)
    points = [{**p, **q} for p in context.chosen(dims[0], 4) for q in context.chosen(dims[1], 3)]
    drawing, (axes,) = panels(1, 1, 0.1 + 0.05 * len(points), wide=True)
    left, bars, names = np.zeros(len(points)), {}, result["item"].to_numpy()
    for row, (name, colour) in enumerate(zip(names, [*COLOURS, "#b0b0b0", "#707070"] * 2, strict=False)):
        amounts = np.array([float(at(cost, fixed, point)[row]) for point in points]) * 1e-6
        if amounts.any():
            bars[str(name).replace("_", " ")] = axes.barh(range(len(points)), amounts, left=left, color=colour)
            left = left + amounts
    words = [context.fulls(point) or "field, tower and receiver" for point in points]
    axes.set(yticks=range(len(points)), yticklabels=words, ylim=(len(points) - 0.5, -0.5),
             xlabel=f"million {cost.attrs['long_name'].split()[-1]}")  # fmt: skip
    axes.grid(True, axis="x")
    legend(drawing, bars)
    return drawing, context.note(fixed)


def aim_points(result: xr.Dataset) -> Any:
    """Draw flux maps and aim points at selected points."""
    context, flux = Context(result), result["aimed_flux_map"]
    if flux["flux_row"].attrs["units"] == "1" or flux["flux_column"].attrs["units"] == "1":
        return None
    dim = next((str(dim) for dim in flux.dims if dim not in DIMS and flux.sizes[dim] > 1), None)
    fixed, points = context.fixed(flux, *DIMS, dim), context.chosen(dim, 4)
    norm, aim = Normalize(0.0, float(flux.max())), json.loads(result.attrs["study"])["aim"]
    drawing, grid = panels(len(points), 2, 0.5, layout="compressed", sharex=True, sharey=True)
    for axes, point in zip(grid, points, strict=False):
        axes.pcolormesh(flux["flux_column"], flux["flux_row"], at(flux, fixed, point), norm=norm, cmap=VALUES)
        number, east, north = (at(result[name], fixed, point).to_numpy() for name in ("aim", "aim_x", "aim_y"))
        up = float(at(result["height_extent"], fixed, point)) * ((number // aim["columns"] + 0.5) / aim["rows"] - 0.5)
        across = np.degrees(np.arctan2(east, north)) % 360.0
        if "receiver_width" in result.coords:
            right = (number % aim["columns"] + 0.5) / aim["columns"] - 0.5
            across = float(at(result["receiver_width"], fixed, point)) * right
        axes.plot(np.where(number < 0.0, np.nan, across), up, ".", color="white", markersize=2)
        axes.set(title=context.fulls(point), xlabel=context.label("flux_column"), ylabel=context.label("flux_row"))
    colour_bar(drawing, grid, norm, colormaps[VALUES], "neither", "flux on the receiver (kW m-2)")
    return drawing, context.note(fixed)


def mirror_outlines(result: xr.Dataset) -> Any:
    """Draw the shaded and blocked areas of the mirror with the largest losses at selected points."""
    context, shading = Context(result), result["shading_efficiency"]
    looks = {
        "shading": ("shadow", COLOURS[0], "", "shaded"),
        "blocking": ("blocked part", COLOURS[1], "///", "blocked"),
    }
    shown = [str(dim) for dim in shading.dims if dim != HELIOSTAT and result.sizes[dim] > 1][:2]
    fixed, dims = context.fixed(shading, HELIOSTAT, *shown), (*shown, None, None)
    points = [{**p, **q} for p in context.chosen(dims[0], 2) for q in context.chosen(dims[1], 2)]
    points = [point for point in points if bool(shading.isel({**fixed, **point}).notnull().any())]  # with the sun up
    if not points:
        return None
    drawing, grid = panels(len(points), 2, 0.9, layout="compressed", sharex=True, sharey=True)
    for axes, point in zip(grid, points, strict=True):
        field = result.isel({**fixed, **point})
        lost = 1 - field[["shading_efficiency", "blocking_efficiency"]].to_dataarray().to_numpy()
        worst = int(np.nanargmax(np.minimum(*lost) + 1e-3 * np.maximum(*lost)))
        one = field.isel({HELIOSTAT: worst}).load()
        a, b = (float(one[f"heliostat_{side}"]) / 2 for side in ("width", "height"))
        axes.add_patch(Rectangle((-a, -b), 2 * a, 2 * b, facecolor="#f2f2f2", edgecolor="black"))
        for effect, (_, colour, hatch, _) in looks.items():
            part = one.sel(effect=effect)
            shapes = np.stack([part[f"outline_{side}"].transpose("image", ...).to_numpy() for side in "uv"], axis=-1)
            for corners, number in zip(shapes, part["outline_heliostat"].to_numpy(), strict=True):
                corners = corners[np.isfinite(corners[:, 0])]
                if len(corners):
                    axes.add_patch(
                        Polygon(corners, facecolor=f"{colour}40", edgecolor=colour, hatch=hatch, linewidth=0.8)
                    )
                    u, v = map(float, corners.mean(axis=0))
                    axes.text(u, v, f"{number:.0f}", ha="center", va="center",
                              color=colour, path_effects=[withStroke(linewidth=2, foreground="white")])  # fmt: skip
        words = " and ".join(f"{100 * (1 - float(one[f'{name}_efficiency'])):.1f} % {look[3]}"
                            for name, look in looks.items())  # fmt: skip
        axes.set(title=f"{fold(context.fulls(point), 45)}\nheliostat {int(one[HELIOSTAT])}: {words}", aspect="equal",
                 xlim=(-1.06 * a, 1.06 * a), ylim=(-1.06 * b, 1.06 * b), xlabel="along the width (m)",
                 ylabel="along the height (m)")  # fmt: skip
    legend(drawing, {word: Patch(facecolor=f"{colour}40", edgecolor=colour, hatch=hatch)
                     for word, colour, hatch, _ in looks.values()})  # fmt: skip
    return drawing, context.note(fixed)
