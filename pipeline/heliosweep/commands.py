"""Functions that run the commands in `cli.COMMANDS` with parsed command-line options."""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import heliosweep
from heliosweep import api
from heliosweep.api import result_folder
from heliosweep.config import OPTION, Study, execution_keys, settings
from heliosweep.config.study import json_schema
from heliosweep.errors import HeliosweepError, Problem, RunInterrupted, StudyError, log, printable
from heliosweep.families.family import families
from heliosweep.files import user_path, written_whole
from heliosweep.runs.run import plan_text
from heliosweep.share import guide
from heliosweep.store.folder import OUTPUTS, check_digest, locate, sources_of, status_lines, target_file, verify

#: Suffixes of the files that `_export` can write.
_TABLES = (".csv", ".xlsx")


class Formatter(logging.Formatter):
    """Formatter that escapes control characters and, if several studies are run, adds the name of the current study."""

    study = ""

    def format(self, record: logging.LogRecord) -> str:
        """Return the formatted text of a log record."""
        return printable(_of_study(super().format(record), self.study))


def carry_out(options: argparse.Namespace) -> int:
    """Run the command that the options specify, print its result, and return the exit code."""
    answer = COMMANDS[options.command](options)
    if isinstance(answer, int):
        return answer
    for item in [answer] if isinstance(answer, str | Path) else answer or ():
        is_path = isinstance(item, Path) and not sys.stdout.isatty()
        print(item if is_path else printable(item))  # paths are printed unchanged for use in other programs
    return 0


def refused(error: HeliosweepError | OSError, study: str = "") -> int:
    """Print the error of a command, preceded by the name of the study if one is given, and return the exit code."""
    text = str(error)
    if isinstance(error, OSError):
        text = f"{error.strerror or error}: {error.filename or ''}".rstrip(": ")
    print(printable(_of_study(text, "" if study in text else study)), file=sys.stderr)
    if isinstance(error, StudyError) and len(error.problems) > 1:
        print(f"{error.count:,} problems found; nothing was written", file=sys.stderr)
    return error.exit_code if isinstance(error, HeliosweepError) else 1


def _of_study(text: str, study: str) -> str:
    return f"{study}: {text}" if study else text


def _load(options: argparse.Namespace, path: str) -> Study:
    study = heliosweep.load(path, settings(options.set), named=OPTION)
    for note in study.notes():
        print(printable(_of_study(f"warning: {note}", Formatter.study)), file=sys.stderr)
    return study.model_copy(update={"execution": study.execution.model_copy(update=_execution(options))})


def _execution(options: argparse.Namespace) -> dict[str, Any]:
    names = ("scheduler", "workers", "memory")
    return execution_keys({name: getattr(options, name, None) for name in names}, "--")


#: Function that returns the result folder of a study that has been run, or a given folder unchanged.
_folder = partial(api.folder_of, there=True)


def _validate(options: argparse.Namespace) -> int:
    code = 0
    for path in options.studies:
        try:
            study = _load(options, path)
            print(printable(f"{path}: valid {study.family} study {study.study_id}"))
        except StudyError as error:
            print(error, file=sys.stderr)
            code = error.exit_code
    return code


def _plan(options: argparse.Namespace) -> str:
    study = _load(options, options.study)
    folder = result_folder(study, options.output)
    return plan_text(study, heliosweep.plan(study, folder, timed=True), folder)


def _run(options: argparse.Namespace) -> int:
    several = len(options.studies) > 1
    if several and options.output is not None:
        raise StudyError(
            Problem("names the result folder of a single study; run only one study, or omit this option", "--output")
        )
    if several and not options.verbose:
        log.setLevel(logging.WARNING)  # one line for each study
    _execution(options)  # reports an invalid option once rather than once per study
    failed: dict[str, int] = {}
    for path in dict.fromkeys(options.studies):
        Formatter.study = path if several else ""
        try:
            _run_one(options, path, several)
        except (RunInterrupted, BrokenPipeError):
            raise
        except Exception as error:  # a failure in one study does not stop the others
            if not several:
                raise
            if isinstance(error, HeliosweepError | OSError) and not (options.verbose and isinstance(error, OSError)):
                failed[path] = refused(error, path)
            else:
                log.exception("failed")
                failed[path] = 1
        finally:
            Formatter.study = ""
    if failed:
        text = f"{len(failed)} of {len(options.studies)} studies failed: {', '.join(failed)}"
        print(printable(text), file=sys.stderr)
    codes = {0, *failed.values()}
    return max(codes) if len(codes) < 3 else 1


def _run_one(options: argparse.Namespace, path: str, several: bool) -> None:
    began, quiet, study = time.perf_counter(), options.quiet, _load(options, path)
    result = heliosweep.run(
        study, options.output, progress=not quiet, report=not options.no_report, force=options.force
    )
    if several and not quiet:
        line = printable(f"{path}: {result.headline()} ({time.perf_counter() - began:.1f} s)")
        print("\r\x1b[K" * sys.stdout.isatty() + line, flush=True)  # replaces a progress line in the terminal
        return
    if not quiet and (lines := result.ending()):
        print(printable(lines), file=sys.stderr)
    print(printable(result.path) if sys.stdout.isatty() else result.path, flush=True)


def _verify(options: argparse.Namespace) -> int:
    code = 0
    for place in options.folders:
        found = verify(_folder(place))
        print(printable(found))
        code = code if found.ok else 1
    return code


def _compare(options: argparse.Namespace) -> Any:
    from heliosweep.store.compare import compare

    places = [_folder(place) for place in (options.first, *options.others)]
    if options.page is not None:
        return heliosweep.comparison_page(places, options.page, force=options.force)
    if len(places) > 2:
        raise StudyError(Problem("is required to compare more than two results", "--page"))
    found = compare(*places, rtol=options.rtol, atol=options.atol)
    print(printable(found))
    return int(not found.same)


def _export(options: argparse.Namespace) -> Path:
    source, target = _folder(options.source), options.output
    if target is None:
        raise StudyError(Problem(f"specify a file, {' or '.join(_TABLES)}", "--output"))
    target_file(target, options.force, endings=_TABLES, sources=_read_for(options.source))
    check_digest(locate(source))
    with heliosweep.open_result(source) as result:
        write = result.heliosweep.to_csv if target.lower().endswith(".csv") else result.heliosweep.to_xlsx
        path: Path = write(target, options.variable, force=options.force)
    return path


def _read_for(source: str) -> set[Path]:
    """Return the files that a command reads from a source, which is a study file, a layout or a result folder."""
    path = user_path(source)
    files, study = {path}, path / "study.resolved.yaml" if path.is_dir() else path
    if study.suffix.lower() in (".yaml", ".yml"):
        with suppress(HeliosweepError, OSError):  # problems in a study are reported later, when the study is used
            files |= sources_of(heliosweep.load(study))
    return files


def _convert(options: argparse.Namespace) -> Path:
    source, whole = user_path(options.source), options.target.lower().endswith((".yaml", ".yml"))
    endings = (".csv", ".yaml", ".yml") if source.is_dir() else (".csv",)
    target_file(options.target, options.force, endings=endings, sources=_read_for(options.source))
    if options.to == "spots" or whole:
        spots = heliosweep.read_paint_spots(options.source, options.aim)
        write = heliosweep.write_paint_study if whole else heliosweep.write_paint_spots
        return write(spots, options.target, force=options.force)
    if (source / "manifest.json").exists():
        with heliosweep.open_result(options.source) as result:
            if options.to == "corrections":
                return heliosweep.write_corrections(result, options.target, dict(options.select), force=options.force)
            layout = heliosweep.layout_of(result, dict(options.select))
    elif options.select:
        raise StudyError(Problem("requires a result folder", "--select"))
    elif source.is_dir():
        layout = heliosweep.read_paint(options.source, options.aim).layout
    elif options.source.lower().endswith((".yaml", ".yml")):
        layout = heliosweep.layout_of(heliosweep.load(options.source))
    else:
        layout = heliosweep.read_layout(options.source)
    form: Any = options.to or ("csv" if source.is_dir() else "solarpilot")
    return heliosweep.write_layout(layout, options.target, form, force=options.force)


def _table(options: argparse.Namespace) -> list[Path]:
    read, maps = _read_for(options.source), options.flux_maps
    file = target_file(options.output, options.force, sources=read)
    if maps is not None:
        target_file(maps, options.force, sources={*read, file})
        if options.form != "tower":
            raise StudyError(Problem("requires --form tower", "--flux-maps"))
    directions = {"select": dict(options.select), "azimuth": options.azimuth, "elevation": options.elevation}
    table = heliosweep.efficiency_table(options.source, **directions, factor=options.factor)
    shares = None if maps is None else heliosweep.flux_maps(options.source, **directions)
    paths = [heliosweep.write_table(table, options.output, options.form, force=options.force)]
    return paths if shares is None else [*paths, heliosweep.write_table(shares, maps, force=options.force)]


def _electricity(options: argparse.Namespace) -> list[Path | str]:
    place = _folder(options.source)
    locate(place)
    file = target_file(options.output or place / "electricity.nc", options.force, endings=(".nc",))
    year = heliosweep.plant_electricity(options.source, dict(options.select), settings(options.sam))
    with written_whole(file) as temporary:
        year.to_netcdf(temporary, engine="netcdf4")
    number = {name: float(value) for name, value in year.items() if not value.dims}
    cost = f"{number['levelized_cost_of_electricity']:,.1f} USD/MWh"
    if number["electricity"] <= 0.0:
        cost = "no cost: the plant consumes more than it generates; SAM's receiver needs a larger field to start"
    return [
        f"electricity: {number['electricity']:,.0f} MWh, {cost}",
        f"turbine: {number['turbine_power']:,.1f} MW gross, capacity factor {100 * number['capacity_factor']:.1f} %",
        f"receiver heat: {float(year.receiver_heat.mean()) * 8760:,.0f} MWh with start-up and full storage, "
        f"{number.get('field_heat', number['field_receiver_energy']):,.0f} MWh in the study",
        file,
    ]


def _schema(options: argparse.Namespace) -> str:
    if options.family not in families():
        raise StudyError(Problem(f"unknown family; the families are {', '.join(families())}", options.family))
    return json.dumps(json_schema(families()[options.family].study_class()), indent=2)


def _setup(_: argparse.Namespace) -> str:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    began = time.perf_counter()
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        # Together, these studies call all kernels. They are in descending order of compilation time.
        fresh = any(list(pool.map(_compile, (
            "chong2012_table1", "surround_energy", "calibration_synthetic", "defieux2020_table1", "gazing_measured",
            "deviation_curves", "mount_error_monte_carlo", "detectors_closed_loop", "dish_world", "liu2022_table2",
        ))))  # fmt: skip
    seconds = time.perf_counter() - began
    return f"compiled the kernels in {seconds:.0f} s" if fresh else "all kernels are compiled"


def _compile(name: str) -> bool:
    """Compile the kernels of a bundled study, and return True if any kernel had not been compiled."""
    from heliosweep.families.lookup import family_of
    from heliosweep.share.guide import shipped

    study = heliosweep.load(shipped()[name])
    return family_of(study).prepare(study)[1]


#: Function that runs each command in `cli.COMMANDS` and returns an exit code or the lines to print.
COMMANDS: dict[str, Callable[[argparse.Namespace], Any]] = {
    "validate": _validate,
    "plan": _plan,
    "run": _run,
    "status": lambda given: (
        list(status_lines(heliosweep.status(*given.of))) or [f"no study has been run in {OUTPUTS}/"]
    ),
    "verify": _verify,
    "compare": _compare,
    "export": _export,
    "convert": _convert,
    "table": _table,
    "electricity": _electricity,
    "weather": lambda given: heliosweep.download_weather(
        given.service, given.latitude, given.longitude, given.output, year=given.year, url=given.url, force=given.force
    ),
    "report": lambda given: api.report(
        _folder(given.folder), vector=[kind for kind in given.format if kind != "png"], summary=given.summary
    ),
    "pack": lambda given: heliosweep.pack_result(
        _folder(given.folder), given.output, license=given.license, draft=given.draft, force=given.force
    ),
    "new": lambda given: guide.new_study(given.family, given.file, force=given.force),
    "explain": lambda given: guide.explain(given.of),
    "examples": lambda given: (
        guide.copy_examples(given.names, given.to, force=given.force) if given.names else guide.examples()
    ),
    "setup": _setup,
    "schema": _schema,
    "families": lambda _: [f"{name:16}  {family.title}" for name, family in families().items()],
}
