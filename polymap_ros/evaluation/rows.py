"""results.csv: a row per trial, kept as they come, so that a run that was interrupted keeps what it has done."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from polymap_ros.atomic import move_into_place, staging


class Result(Protocol):
    """What a job answers with."""

    def row(self) -> dict[str, object]:
        """Cells by column; the columns are the same for all results of a run."""


class PartialRows:
    """The rows so far, in ``results.partial.csv``: in the order in which the jobs were done.

    The file appears with the rows of the first job in it, and those of every other are added in one piece: whenever the
    run is interrupted, it holds whole rows. A run that comes to its end writes results.csv, in order, and then discards
    this file.

    Parameters
    ----------
    folder : Path
        Made where it is missing, with the first row.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / 'results.partial.csv'
        self._begun = False

    def add(self, results: Sequence[Result]) -> None:
        """Append the rows of a job."""
        if not results:
            return
        text = csv_text(results, header=not self._begun).encode()
        if self._begun:
            with self.path.open('ab', buffering=0) as file:
                file.write(text)
            return
        with staging(self.path) as stage:
            (stage / self.path.name).write_bytes(text)
            move_into_place(stage / self.path.name, self.path)
        self._begun = True

    def discard(self) -> None:
        """Remove the file; results.csv has taken its place."""
        self.path.unlink(missing_ok=True)


def csv_text(results: Sequence[Result], header: bool = True) -> str:
    """One row per result, under a header; empty cells where there is no value."""
    text = io.StringIO()
    rows: list[Mapping[str, object]] = [result.row() for result in results]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator='\n')
    if header:
        writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: object) -> object:
    if value is None:
        return ''
    if isinstance(value, bool):
        return int(value)
    return f'{value:.9g}' if isinstance(value, float) else value
