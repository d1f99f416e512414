"""summary.csv of many recordings: a row for each that is over, at any time, also of earlier runs."""

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from polymap_ros.atomic import move_into_place, staging
from polymap_ros.commands import console
from polymap_ros.commands.mapped import PROGRAM
from polymap_ros.commands.replaying import Outcome
from polymap_ros.errors import OutputError, UsageError, in_words
from polymap_ros.results.folder import POLYGON

SUMMARY = 'summary.csv'
COLUMNS = 'name', 'status', 'warnings', 'edges', 'area', 'pings', 'seconds', 'error'
ENDS = 'done', 'open', 'failed'


class Ledger:
    """Keep how each recording ended, and write it after each, so that an interruption leaves all rows so far.

    Rows of earlier runs stay while the result folder that they speak of is there, until this run has one of that name.

    Parameters
    ----------
    folder : Path
        In which summary.csv is written.
    names : dict of Path to str
        Of the recordings, in the order of the rows.

    Raises
    ------
    UsageError
        Where a summary.csv is there that is not of an earlier run.
    OutputError
        Where it cannot be written.
    """

    def __init__(self, folder: Path, names: dict[Path, str]) -> None:
        self.path = folder / SUMMARY
        self._names = names
        self._outcomes: dict[str, Outcome] = {}
        self._failed = self._behind = False
        self._earlier = self._read()
        self._before = {name: self._identity(name) for name in names.values()}
        try:
            self._write()
        except OSError as error:
            raise OutputError(self.path, in_words(error, folder)) from error

    def add(self, outcome: Outcome) -> None:
        """Take in how a recording ended; where it cannot be written, that is told once, and the work goes on."""
        self._outcomes[self._names[outcome.recording]] = outcome
        try:
            self._write()
            self._behind = False
        except OSError as error:
            self._behind = True
            if not self._failed:
                console.complain(PROGRAM, f'error: {self.path}: cannot be written: {in_words(error, self.path.parent)}')
            self._failed = True

    @property
    def outcomes(self) -> list[tuple[str, Outcome]]:
        """Those that are over, by name, in the order of the rows."""
        return [(name, self._outcomes[name]) for name in self._names.values() if name in self._outcomes]

    @property
    def earlier(self) -> list[tuple[str, dict[str, str]]]:
        """The rows of earlier runs by name, but for those that are over in this one."""
        return [(name, dict(zip(COLUMNS, cells, strict=True))) for name, cells in self._earlier.items()
                if name not in self._outcomes]

    def add_interrupted(self) -> None:
        """Take in the answers that are there of recordings that are not over."""
        for recording, name in self._names.items():
            if name not in self._outcomes and self._identity(name) not in (None, self._before[name]):
                self.add(_interrupted(recording, self.path.parent / name))

    @property
    def status(self) -> int:
        """The highest exit status so far."""
        lost = [console.WRONG] if self._failed else []
        return max([outcome.status for outcome in self._outcomes.values()] + lost, default=console.DONE)

    def tell(self) -> None:
        """Print the last line: how many ended how."""
        ends = Counter(map(end_of, self._outcomes.values()))
        counts = ', '.join(f'{ends[end]} {end}' for end in ENDS)
        left = len(self._names) - len(self._outcomes)
        unfinished = f', {left} not finished' if left else ''
        lacking = ' lacks the last rows: it could not be written' if self._behind else ''
        console.tell(f'{counts}{unfinished}; {console.in_one_line(self.path)}{lacking}')

    def _read(self) -> dict[str, list[str]]:
        """The rows of earlier runs whose folders are there, by the names of these."""
        try:
            with self.path.open(encoding='utf-8', newline='') as file:
                first, *rows = csv.reader(file)
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, csv.Error):
            first, rows = [], []
        if tuple(first) != COLUMNS:
            raise UsageError(f'{self.path}: is not of an earlier run, and the summary would take its place; move it '
                             'away, or choose another --output')
        for number, row in enumerate(rows, 2):
            if len(row) != len(COLUMNS):
                raise UsageError(f'{self.path}: line {number} has {len(row)} cells, not {len(COLUMNS)}, and would be '
                                 'lost; mend it, move the file away, or choose another --output')
        folders = {_cell(path.name): path.name for path in self.path.parent.iterdir() if path.is_dir()}
        found = [(folders.get(_cell(row[0])), row) for row in rows]
        return {name: row for name, row in found if name}

    def _identity(self, name: str) -> tuple[int, int] | None:
        """What tells a polygon.json from the one that takes its place."""
        try:
            found = (self.path.parent / name / POLYGON).stat()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns

    def _write(self) -> None:
        rows = [_row(name, outcome) for name, outcome in self.outcomes]
        rows += [tuple(row.values()) for _, row in self.earlier]
        with staging(self.path) as stage:
            (stage / SUMMARY).write_bytes(_csv([COLUMNS, *rows]))
            move_into_place(stage / SUMMARY, self.path)


def _interrupted(recording: Path, folder: Path) -> Outcome:
    """What is known of a recording whose answer is there, and perhaps not all files beside it."""
    document = json.loads((folder / POLYGON).read_bytes())
    return Outcome(
        recording, folder, console.INTERRUPTED, document['status'],
        tuple(each['code'] for each in document['warnings']), len(document['edges']) or None, document['area'],
        document['area_std'], document['pings']['received'], document['pings']['used'], math.nan,
        'interrupted: files beside polygon.json may be missing')


def end_of(outcome: Outcome) -> str:
    """Return how a recording ended: an answer that is written is not failed, whatever else is missing."""
    return {'closed': 'done', 'ambiguous': 'open', 'open': 'open'}.get(outcome.answer, 'failed')


def _row(name: str, outcome: Outcome) -> Sequence[object]:
    area = '' if outcome.area_m2 is None else f'{outcome.area_m2:.6g}'
    codes = ';'.join(dict.fromkeys(outcome.warnings))
    edges = '' if outcome.edges is None else outcome.edges
    seconds = '' if math.isnan(outcome.seconds) else f'{outcome.seconds:.1f}'
    cells = name, end_of(outcome), codes, edges, area, outcome.pings_used, seconds, ' '.join(outcome.error.split())
    return [_cell(cell) for cell in cells]


def _cell(value: object) -> str:
    """A cell's text; a name that a spreadsheet would take for a formula is written as the same path."""
    text = console.in_one_line(value)
    return f'./{text}' if text.startswith(('=', '+', '-', '@')) else text


def _csv(rows: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator='\n').writerows(rows)
    return text.getvalue().encode()
