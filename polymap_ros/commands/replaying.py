"""One recording of `polymap_replay`: heard, solved, told, and written."""

import argparse
import dataclasses
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from polymap_ros.commands import console
from polymap_ros.commands.mapped import PROGRAM, Mapped, map_recording
from polymap_ros.errors import OutputError, PolymapError, in_words
from polymap_ros.parameters import Parameters

if TYPE_CHECKING:
    from polymap_ros.geometry.alignment import PathError
    from polymap_ros.geometry.inside_error import InsideComparison
    from polymap_ros.geometry.pose import Pose
    from polymap_ros.results.folder import Entry

_TO_ALIGN = 2
"""Pings by which a path can be brought onto another."""


@dataclass(frozen=True)
class Outcome:
    """How a recording ended.

    Parameters
    ----------
    recording, folder : Path
        As given, and where its results are.
    status : int
        Exit status.
    answer : str
        Status of the estimate: ``closed``, ``ambiguous`` or ``open``; empty where there is none, or where it could not
        be written.
    warnings : tuple of str
        Codes of the cautions.
    edges : int or None
        Of a closed polygon.
    area_m2, area_std_m2 : float or None
        Of a closed polygon [m2].
    pings_received, pings_used : int
        Counts.
    seconds : float
        Time that it took [s].
    error : str
        Why there is no answer, or which files are missing beside it; empty where nothing is wrong.
    """

    recording: Path
    folder: Path
    status: int
    answer: str = ''
    warnings: tuple[str, ...] = ()
    edges: int | None = None
    area_m2: float | None = None
    area_std_m2: float | None = None
    pings_received: int = 0
    pings_used: int = 0
    seconds: float = 0.0
    error: str = ''


def replayed(path: Path, folder: Path, parameters: Parameters, arguments: argparse.Namespace) -> Outcome:
    """Replay one recording; whatever goes wrong is one line on stderr and an outcome."""
    began_s = time.monotonic()
    try:
        with console.stops_heeded():
            return _replay(path, folder, parameters, arguments)
    except Exception as error:  # a fault of ours, too, costs this recording only
        text = in_words(error) if isinstance(error, PolymapError) else f'{path}: {in_words(error)}'
        console.complain(PROGRAM, f'error: {text}')
        return Outcome(path, folder, console.WRONG, seconds=time.monotonic() - began_s, error=text)


def _replay(path: Path, folder: Path, parameters: Parameters, arguments: argparse.Namespace) -> Outcome:
    from polymap_ros.recordings.finding import recording_name
    from polymap_ros.recordings.reading import Recording
    from polymap_ros.results.folder import check_folder, write_results
    from polymap_ros.results.save import answer

    began_s = time.monotonic()
    console.tell_compiling(PROGRAM)
    check_folder(folder)
    with Recording.open(path) as recording:
        mapped = map_recording(recording, parameters, arguments)
        _tell(mapped, arguments.exports)
        _complain(mapped)
        if arguments.record:
            _complain_of_the_record(mapped)
        files = answer(mapped.mapper, mapped.estimate, mapped.parameters, mapped.cautions, recording_name(path))
        saved = True
        try:
            unwritten = write_results(folder, files, _accompaniments(mapped, arguments))
            problems = [each.within(folder) for each in unwritten]
            console.tell(f'{time.monotonic() - began_s:.1f} s; results in {console.in_one_line(folder)}')
        except OutputError as error:
            saved, problems = False, [str(error)]
    for problem in problems:
        console.complain(PROGRAM, f'error: {problem}')
    outcome = _outcome(mapped, folder, time.monotonic() - began_s, '; '.join(problems))
    return outcome if saved else dataclasses.replace(outcome, answer='')


def _accompaniments(mapped: Mapped, arguments: argparse.Namespace) -> 'Iterator[Entry]':
    """Give what is written beside the answer, in this order; whatever one of them raises costs only its own files."""
    from polymap_ros.geometry.plane import XY
    from polymap_ros.recordings.replay import some_pings
    from polymap_ros.results import folder as names
    from polymap_ros.results.arrays import beam_map_npz, npy
    from polymap_ros.results.calibration_yaml import calibration_yaml
    from polymap_ros.results.export import exported
    from polymap_ros.results.folder import Entry
    from polymap_ros.results.picture import picture_png
    from polymap_ros.results.save import map_files
    from polymap_ros.results.signal_picture import signals_png

    mapper, estimate, parameters, replay = mapped.mapper, mapped.estimate, mapped.parameters, mapped.replay
    interval_s = arguments.start, arguments.end
    if fit := mapped.fit:
        yield Entry.of(names.CALIBRATION, lambda: calibration_yaml(fit.values, fit.deviations))
    if pulse := mapped.pulse:
        yield Entry.of(names.PULSE, lambda: npy(pulse.recorded.recorded))
    yield from map_files(estimate, parameters)
    for kind in arguments.exports:
        yield Entry.of(f'polygon.{kind}', partial(exported, kind, estimate, mapper.map_frame, mapper.plane or XY))
    if arguments.save_map:
        yield Entry.of(names.BEAM_MAP, lambda: beam_map_npz(mapper.surroundings.beam_map, mapper.start_pose))
    if arguments.plot:
        yield Entry.of(names.PICTURE, lambda: picture_png(mapper, estimate, mapped.truth, mapped.true_path))
    if arguments.plot_signals:
        yield Entry.of(names.SIGNALS, lambda: signals_png(
            mapper, some_pings(mapped.recording, replay.echo_topic, parameters, *interval_s)))
    if arguments.report:
        yield Entry.of(names.REPORT, partial(_report, mapped))
    if arguments.record:
        yield Entry((names.RECORD,), partial(_write_record, mapped, interval_s))


def _report(mapped: Mapped) -> bytes:
    from polymap_ros.geometry.plane import XY
    from polymap_ros.recordings.finding import recording_name
    from polymap_ros.results.polygon_json import polygon_document
    from polymap_ros.results.report.heard import Survey
    from polymap_ros.results.report.page import report_html

    mapper, estimate = mapped.mapper, mapped.estimate
    document = polygon_document(
        estimate, mapper.map_frame, mapper.counts, mapped.parameters, mapped.cautions, mapper.plane or XY,
        recording_name(mapped.recording.path), map_to_odom=mapper.map_to_odom)
    return report_html(document, [*estimate.cautions, *mapped.cautions], Survey.of(mapper, mapped.truth))


def _write_record(mapped: Mapped, interval_s: 'tuple[float | None, float | None]', folder: Path) -> None:
    from polymap_ros.pulse_file import read_pulse
    from polymap_ros.recordings.outcome import write_outcome
    from polymap_ros.results.folder import RECORD
    from polymap_ros.results.loading import loaded_mapper

    with console.progress(f'{mapped.recording.path.name}: recording', mapped.replay.total, 'msg') as advance:
        pulse = mapped.pulse.recorded if mapped.pulse else read_pulse(mapped.parameters)
        again = loaded_mapper(mapped.parameters, pulse)
        write_outcome(folder / RECORD, mapped.recording, mapped.mapper, again, *interval_s, advance)


def _tell(mapped: Mapped, exports: Sequence[str]) -> None:
    """Print the answer, before anything is written that may fail."""
    from polymap_ros.geometry.polygon_error import compare
    from polymap_ros.results.export import is_exported
    from polymap_ros.results.summary import summary

    mapper, odometry, truth = mapped.mapper, mapped.replay.odometry, mapped.truth
    frame = mapper.map_frame
    if mapper.plane and not mapper.plane.is_xy:
        frame = f'the plane of the first pose in {frame}'
    motion, off = _aligned(mapped)
    comparison = compare(motion.apply(mapped.closed.vertices), truth) if mapped.closed and truth is not None else None
    others = [each for each in (*mapped.estimate.cautions, *mapped.cautions) if each not in mapped.complaints]
    inside = _compared_inside(mapped, motion) if comparison else None
    text = summary(mapped.estimate, frame, mapper.counts, others, comparison, off, inside)
    console.tell(f'{console.in_one_line(mapped.recording.path)}: {text}')
    console.tell(f'odometry: {odometry.received} received, {odometry.used} used')
    if mapped.parameters.slam.map_origin != 'odom' and mapper.origin is not None:
        console.tell(f'{frame}: its origin is at {mapper.origin.text} of {mapper.frame_id!r}')
    if missing := [f'polygon.{kind}' for kind in exports if not is_exported(kind, mapped.estimate)]:
        console.tell(f'no {", ".join(missing)}: there is no polygon to export')


def _compared_inside(mapped: Mapped, motion: 'Pose') -> 'InsideComparison | None':
    """Holes and inner walls, moved, against the true ones; none where they are not known."""
    from polymap_ros.geometry.inside_error import compare_inside

    if mapped.true_inside is None:
        return None
    found = mapped.estimate
    return compare_inside(
        [motion.apply(hole.vertices) for hole in found.holes],
        [motion.apply(wall.ends) for wall in found.inner_walls],
        mapped.true_inside.holes, mapped.true_inside.inner_walls, true_circles=mapped.true_inside.circles)


def _aligned(mapped: Mapped) -> 'tuple[Pose, PathError | None]':
    """The motion that brings an estimated path onto the true one, and how far it is off then; none where not known."""
    import numpy as np

    from polymap_ros.geometry.alignment import alignment, path_error
    from polymap_ros.geometry.pose import Pose

    if mapped.true_path is None:
        return Pose(0.0, 0.0), None
    path, (stamps, poses) = mapped.mapper.path(), mapped.true_path
    _, mine, true = np.intersect1d(path.stamps_ns[~path.lost], stamps, return_indices=True)
    if len(mine) < _TO_ALIGN:
        return Pose(0.0, 0.0), None
    found = path.poses[~path.lost][mine]
    motion = alignment(found[:, :2], poses[true, :2])
    off = path_error(found, poses[true], motion)
    return motion if mapped.estimate.trajectory else Pose(0.0, 0.0), off


def _complain(mapped: Mapped) -> None:
    """Say on stderr why no polygon closes, or what the answer lacks; `_tell` leaves that out."""
    path = mapped.recording.path
    if mapped.closed is None:
        console.complain(PROGRAM, f'{path}: {_reason(mapped)}')
        return
    for caution in mapped.complaints:
        console.complain(PROGRAM, f'warning: {path}: {caution.text}')


def _complain_of_the_record(mapped: Mapped) -> None:
    """Say where the messages of result.mcap hold less than the answer."""
    from polymap_ros.geometry.plane import XY
    from polymap_ros.messages.outputs import coarse_polygon
    from polymap_ros.results.folder import RECORD

    polygon = mapped.estimate.polygon
    if polygon and (coarse := coarse_polygon(polygon, mapped.mapper.plane or XY)):
        console.complain(PROGRAM, f'warning: {mapped.recording.path}: {RECORD}: {coarse.finding}; ~/markers in it and '
                                  'polygon.json are exact')


def _outcome(mapped: Mapped, folder: Path, seconds: float, error: str) -> Outcome:
    from polymap_ros.results.dimensions import net_area

    estimate, closed, counts = mapped.estimate, mapped.closed, mapped.mapper.counts
    area_m2, area_std_m2 = net_area(closed, estimate.holes) if closed else (None, None)
    status = console.DONE if closed else console.NO_POLYGON
    return Outcome(
        mapped.recording.path, folder, console.WRONG if error else status, estimate.status,
        tuple(each.code for each in (*estimate.cautions, *mapped.cautions)),
        len(closed.edges) if closed else None, area_m2, area_std_m2, counts.received, counts.used, seconds, error)


def _reason(mapped: Mapped) -> str:
    """Why no polygon closes."""
    parts = [caution.text for caution in mapped.complaints]
    return f'{mapped.estimate.status}, no polygon closes: {"; ".join(parts)}'
