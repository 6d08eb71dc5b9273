"""Command line: results go to standard output, progress and messages to standard error."""

from __future__ import annotations

import argparse
import io
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import heliosweep
from heliosweep.arguments import parser
from heliosweep.errors import HeliosweepError, Problem, RunInterrupted, StudyError, printable

if TYPE_CHECKING:
    from pathlib import Path

    from heliosweep.config.study import Study

log = logging.getLogger("heliosweep")

#: Endings of the files that `export` writes as tables.
_TABLES = (".csv", ".xlsx")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, by default from ``sys.argv``, and return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _interrupt)
    given = sys.argv[1:] if arguments is None else arguments
    if not given:
        parser().print_help(sys.stderr)
        return 2
    options = parser().parse_args(given)
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Printable("%(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    logging.getLogger("heliosweep").setLevel(logging.DEBUG if options.verbose else logging.INFO)
    return _exit_code(options)


def _interrupt(*_: object) -> None:
    """End like Ctrl-C does."""
    raise KeyboardInterrupt


def _exit_code(options: argparse.Namespace) -> int:
    """Run a command and return its exit code."""
    try:
        return COMMANDS[options.command](options) or 0
    except (RunInterrupted, KeyboardInterrupt) as stop:
        _print(str(stop) or "interrupted", sys.stderr)
        return RunInterrupted.exit_code
    except BrokenPipeError:
        # The reader of our output (head, less) went away: not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (HeliosweepError, OSError) as error:
        if options.verbose and isinstance(error, OSError):
            raise
        return _refused(error)


def _refused(error: HeliosweepError | OSError, study: str = "") -> int:
    """Print the error of a command, or of one study of several, and return the exit code."""
    if isinstance(error, OSError):
        _print(f"{_prefix(study)}{error.strerror or error}: {error.filename or ''}".rstrip(": "), sys.stderr)
        return 1
    print(error if study in str(error) else f"{printable(_prefix(study))}{error}", file=sys.stderr)
    if isinstance(error, StudyError) and len(error.problems) > 1:
        print(f"{error.count:,} problems found; nothing was written", file=sys.stderr)
    return error.exit_code


def _prefix(study: str) -> str:
    """Return the beginning of a message about one study of several."""
    return f"{study}: " if study else ""


class _Printable(logging.Formatter):
    """Formatter that escapes control characters and names the current study if there are several."""

    study = ""

    def format(self, record: logging.LogRecord) -> str:
        return printable(_prefix(self.study) + super().format(record))


def _print(text: object, file: Any = None) -> None:
    """Print text that may contain untrusted names and titles."""
    print(printable(text), file=file)


def _print_path(path: Any) -> None:
    """Print a path, unchanged if another program reads it."""
    print(printable(path) if sys.stdout.isatty() else path)


def _load(options: argparse.Namespace, path: str) -> Study:
    """Load a study with the options of the command line, and print its warnings."""
    from heliosweep.config.load import OPTION, settings

    study = heliosweep.load(path, settings(options.set), named=OPTION)
    for note in study.notes():
        _print(f"{_prefix(_Printable.study)}warning: {note}", sys.stderr)
    return study.model_copy(update={"execution": study.execution.model_copy(update=_execution(options))})


def _execution(options: argparse.Namespace) -> dict[str, Any]:
    """Return the keys of ``execution`` on the command line, checked as in a study file."""
    from heliosweep.config.load import execution_keys

    names = ("scheduler", "workers", "memory")
    return execution_keys({name: getattr(options, name, None) for name in names}, "--")


def _folder(place: str) -> Path:
    """Return the result folder of a study that has been run, or the folder itself."""
    from heliosweep.api import folder_of

    return folder_of(place, there=True)


def _validate(options: argparse.Namespace) -> int:
    code = 0
    for path in options.studies:
        try:
            study = _load(options, path)
            _print(f"{path}: valid {study.family} study {study.study_id}")
        except StudyError as error:
            print(error, file=sys.stderr)
            code = error.exit_code
    return code


def _plan(options: argparse.Namespace) -> None:
    from heliosweep.results import result_folder
    from heliosweep.runs.run import plan_text

    study = _load(options, options.study)
    folder = result_folder(study, options.output)
    _print(plan_text(study, heliosweep.plan(study, folder, timed=True), folder))


def _run(options: argparse.Namespace) -> int:
    several = len(options.studies) > 1
    if several and options.output is not None:
        raise StudyError(Problem("is the folder of one study; run one study, or omit it", "--output"))
    _execution(options)  # an error is printed once
    failed: dict[str, int] = {}
    for path in dict.fromkeys(options.studies):
        _Printable.study = path if several else ""
        try:
            _run_one(options, path, several)
        except (RunInterrupted, BrokenPipeError):
            raise
        except Exception as error:  # a failure in one study does not stop the others
            if not several:
                raise
            if isinstance(error, HeliosweepError | OSError) and not (options.verbose and isinstance(error, OSError)):
                failed[path] = _refused(error, path)
            else:
                log.exception("failed")
                failed[path] = 1
        finally:
            _Printable.study = ""
    if failed:
        _print(f"{len(failed)} of {len(options.studies)} studies failed: {', '.join(failed)}", sys.stderr)
    codes = {0, *failed.values()}
    return max(codes) if len(codes) < 3 else 1


def _run_one(options: argparse.Namespace, path: str, several: bool) -> None:
    began = time.perf_counter()
    study = _load(options, path)
    result = heliosweep.run(
        study, options.output, progress=not options.quiet, report=not options.no_report, force=options.force
    )
    if several and not options.quiet:
        _print(f"{path}: {result.headline()} ({time.perf_counter() - began:.1f} s)", sys.stderr)
    elif not options.quiet and (lines := result.ending()):
        _print(lines, sys.stderr)
    _print_path(result.path)


def _status(options: argparse.Namespace) -> None:
    from heliosweep.store.folder import OUTPUTS, status_lines

    found = heliosweep.status(*options.of)
    _print("\n".join(status_lines(found)) or f"no study has been run in {OUTPUTS}/")


def _verify(options: argparse.Namespace) -> int:
    from heliosweep.runs.verify import verify

    code = 0
    for place in options.folders:
        found = verify(_folder(place))
        _print(found)
        code = code if found.ok else 1
    return code


def _compare(options: argparse.Namespace) -> int:
    from heliosweep.store.compare import compare

    places = [_folder(place) for place in (options.first, *options.others)]
    if options.page is not None:
        _print_path(heliosweep.comparison_page(places, options.page, force=options.force))
        return 0
    if len(places) > 2:
        raise StudyError(Problem("is required to compare more than two results", "--page"))
    found = compare(*places, rtol=options.rtol, atol=options.atol)
    _print(found)
    return 0 if found.same else 1


def _export(options: argparse.Namespace) -> None:
    from heliosweep.store.folder import target_file
    from heliosweep.store.read import check_digest, export, locate

    source, target = _folder(options.source), options.output
    if options.variable and target is None:
        raise StudyError(Problem(f"requires --output with a file {' or '.join(_TABLES)}", "--variable"))
    if not (options.variable or str(target).lower().endswith(_TABLES)):
        _print_path(export(source, target, compression=options.compression, force=options.force))
        return
    target_file(target, options.force, endings=_TABLES, sources=_read_for(options.source))
    check_digest(locate(source))
    with heliosweep.open_result(source) as result:
        write = result.heliosweep.to_csv if target.lower().endswith(".csv") else result.heliosweep.to_xlsx
        _print_path(write(target, options.variable, force=options.force))


def _read_for(source: str) -> set[Any]:
    """Return the files that a command reads for a study file, layout or result folder."""
    from heliosweep.files import user_path
    from heliosweep.store.folder import sources_of

    files, path = {user_path(source)}, user_path(source)
    if path.is_dir():
        path = path / "study.resolved.yaml"
    if path.suffix.lower() in (".yaml", ".yml"):
        with suppress(HeliosweepError, OSError):  # reported when the study is used
            files |= sources_of(heliosweep.load(path))
    return files


def _convert(options: argparse.Namespace) -> None:
    from heliosweep.files import user_path
    from heliosweep.store.folder import target_file

    target_file(options.target, options.force, sources=_read_for(options.source))
    is_folder = user_path(options.source).is_dir()
    if options.to == "spots":
        spots = heliosweep.read_paint_spots(options.source, options.aim)
        _print_path(heliosweep.write_paint_spots(spots, options.target, force=options.force))
        return
    if is_folder and (user_path(options.source) / "manifest.json").exists():
        with heliosweep.open_result(options.source) as result:
            layout = heliosweep.layout_of(result, dict(options.select))
    elif options.select:
        raise StudyError(Problem("requires a result folder", "--select"))
    elif is_folder:
        layout = heliosweep.read_paint(options.source, options.aim).layout
    elif options.source.lower().endswith((".yaml", ".yml")):
        layout = heliosweep.layout_of(heliosweep.load(options.source))
    else:
        layout = heliosweep.read_layout(options.source)
    form: Any = options.to or ("csv" if is_folder else "solarpilot")
    _print_path(heliosweep.write_layout(layout, options.target, form, force=options.force))


def _table(options: argparse.Namespace) -> None:
    from heliosweep.store.folder import target_file

    read, maps = _read_for(options.source), options.flux_maps
    file = target_file(options.output, options.force, sources=read)
    if maps is not None:
        target_file(maps, options.force, sources={*read, file})
        if options.form != "tower":
            raise StudyError(Problem("requires --form tower", "--flux-maps"))
    chosen: dict[str, Any] = {
        "select": dict(options.select),
        "azimuth": options.azimuth,
        "elevation": options.elevation,
    }
    table = heliosweep.efficiency_table(options.source, **chosen, factor=options.factor)
    shares = None if maps is None else heliosweep.flux_maps(options.source, **chosen)
    _print_path(heliosweep.write_table(table, options.output, options.form, force=options.force))
    if shares is not None:
        _print_path(heliosweep.write_table(shares, maps, force=options.force))


def _report(options: argparse.Namespace) -> None:
    from heliosweep.api import report

    folder = _folder(options.folder)
    vector = [kind for kind in options.format if kind != "png"]
    _print_path(report(folder, vector=vector, summary=options.summary))


def _pack(options: argparse.Namespace) -> None:
    folders = [_folder(folder) for folder in options.folders]
    keys = {"license": options.license, "draft": options.draft, "ro_crate": options.ro_crate, "force": options.force}
    _print_path(heliosweep.pack_result(folders, options.output, **keys))


def _new(options: argparse.Namespace) -> None:
    from heliosweep.share.guide import new_study

    _print_path(new_study(options.family, options.file, force=options.force))


def _explain(options: argparse.Namespace) -> None:
    from heliosweep.share.guide import explain

    _print(explain(options.of))


def _examples(options: argparse.Namespace) -> None:
    from heliosweep.share.guide import copy_examples, examples

    if not options.names:
        _print(examples())
        return
    for path in copy_examples(options.names, options.to, force=options.force):
        _print_path(path)


def _schema(options: argparse.Namespace) -> None:
    from heliosweep.families.family import families

    known = families()
    if options.family not in known:
        raise StudyError(Problem(f"unknown family; the families are {', '.join(known)}", options.family))
    import json

    from heliosweep.config.schema import editor_schema

    print(json.dumps(editor_schema(known[options.family].study_class()), indent=2))


def _families(_: argparse.Namespace) -> None:
    from heliosweep.families.family import families

    width = max(map(len, families()))
    for name, family in families().items():
        print(f"{name:{width}}  {family.title}")


#: Shipped studies that together call all kernels, the longest compilation first.
_KERNELS = (
    "chong2012_table1", "surround_energy", "calibration_synthetic", "defieux2020_table1", "gazing_measured",
    "deviation_curves", "mount_error_monte_carlo", "detectors_closed_loop", "dish_world", "liu2022_table2",
)  # fmt: skip


def _setup(options: argparse.Namespace) -> None:
    """Compile all kernels in two processes."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    began = time.perf_counter()
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        fresh = any(list(pool.map(_compile, _KERNELS)))
    seconds = time.perf_counter() - began
    _print(f"compiled the kernels in {seconds:.0f} s" if fresh else "all kernels are compiled")


def _compile(name: str) -> bool:
    """Compile the kernels of a shipped study; return True if the compiler was called."""
    from heliosweep.families.lookup import family_of
    from heliosweep.share.guide import shipped

    study = heliosweep.load(shipped()[name])
    return family_of(study).prepare(study)[1]


#: Function of each command; returns the exit code, or None for 0.
COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    "validate": _validate,
    "plan": _plan,
    "run": _run,
    "status": _status,
    "verify": _verify,
    "compare": _compare,
    "export": _export,
    "convert": _convert,
    "table": _table,
    "report": _report,
    "pack": _pack,
    "new": _new,
    "explain": _explain,
    "examples": _examples,
    "setup": _setup,
    "schema": _schema,
    "families": _families,
}
