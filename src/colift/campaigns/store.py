"""Folder with the rows of a campaign: one file per batch, written completely or not at all.

The files are `parts/HASH.parquet`, or `parts/HASH.csv` with the same columns without pyarrow. A campaign has no list
of its results: the rows that the files contain are complete, and all others are computed. The name of a file
depends on the flights in it, so that two writers of the same batch write the same file.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
from collections.abc import Collection, Generator, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

from colift.campaigns.flights import Row, log_file
from colift.runtime import atomic_write, bounded_read, extras, run_directory

TEXT_COLUMNS = ("id", "case", "termination_reason", "warnings", "worker", "version", "versions")
"""Columns that contain text."""
COMPLETION_COLUMNS = ("id", "version", "termination_reason")
"""Columns from which the complete flights follow."""
MAX_PART_BYTES = 2**28
"""Largest file of a store [bytes]."""


@dataclasses.dataclass(frozen=True)
class Store:
    """Folder of a campaign.

    Attributes:
        folder: Folder of the results.
    """

    folder: Path

    @property
    def parts(self) -> Path:
        """Folder of the rows."""
        return self.folder / "parts"

    @property
    def logs(self) -> Path:
        """Folder of the logs of single flights."""
        return self.folder / "signals"

    def read(self, columns: Collection[str] | None = None) -> pd.DataFrame:
        """Read all rows, each flight once.

        Args:
            columns: Columns to read, with `id`; None: all.

        Returns:
            Table; columns that no file contains are absent.

        Raises:
            OSError: If a file cannot be read, is damaged, or requires pyarrow.
        """
        frames = [_read_part(file, columns) for file in part_files(self.parts)]
        if not frames:
            return pd.DataFrame(columns=list(TEXT_COLUMNS), dtype=object)
        table = pd.concat(frames, ignore_index=True).drop_duplicates("id", ignore_index=True)
        names = [name for name in TEXT_COLUMNS if name in table]
        return table.astype(dict.fromkeys(names, object)).fillna(dict.fromkeys(names, ""))

    def stored_ids(self, with_logs: bool = False) -> frozenset[str]:
        """Return the identifiers of the flights that are complete.

        Args:
            with_logs: Whether a flight that was simulated also requires its log.

        Raises:
            OSError: As `read`, and if rows are of another version of colift.
        """
        return self.complete_ids(self.read(COMPLETION_COLUMNS), with_logs)

    def complete_ids(self, found: pd.DataFrame, with_logs: bool = False) -> frozenset[str]:
        """Return the identifiers of the flights of a table that are complete; see `stored_ids`.

        Args:
            found: Table with `COMPLETION_COLUMNS`.
            with_logs: As in `stored_ids`.
        """
        others = sorted(set(found["version"]) - {version("colift")})
        if others:
            raise OSError(
                f"{self.folder} contains rows of colift {', '.join(map(str, others))}, and this is "
                f"{version('colift')}: choose another --out, or install that version"
            )
        if not with_logs:
            return frozenset(found["id"])
        without = found["termination_reason"].str.startswith(("lost: ", "refused: "))
        flown = zip(found["id"], without, strict=True)
        return frozenset(name for name, no_log in flown if no_log or log_file(self.logs, name).exists())

    def add(self, rows: Sequence[Row]) -> Path:
        """Write the rows of one batch as a new file.

        Args:
            rows: Rows of the batch.

        Returns:
            The file.

        Raises:
            OSError: If the file cannot be written.
        """
        digest = hashlib.sha256("".join(sorted(str(row["id"]) for row in rows)).encode()).hexdigest()[:16]
        suffix = "parquet" if has_pyarrow() else "csv"
        path = self.parts / f"{digest}.{suffix}"
        atomic_write.write_atomic(path, encode(pd.DataFrame(rows), suffix))
        return path


@contextlib.contextmanager
def open_store(folder: Path) -> Generator[Store]:
    """Lock the folder of a campaign for this process; OSError is raised as by `run_directory.lock_directory`.

    Args:
        folder: Folder of the results.

    Yields:
        The store.
    """
    with run_directory.lock_directory(folder) as resolved:
        store = Store(resolved)
        try:
            store.parts.mkdir(exist_ok=True)
            for leftover in (*store.parts.glob(".*.part"), *store.logs.glob(".*.part")):
                leftover.unlink()
        except OSError as error:
            raise OSError(error.errno, f"cannot write to {folder}: {error.strerror}") from None
        yield store


def part_files(folder: Path) -> list[Path]:
    """Return the files with rows, in alphabetical order."""
    return sorted([*folder.glob("*.parquet"), *folder.glob("*.csv")])


def has_pyarrow() -> bool:
    """Return whether Parquet files can be written."""
    return find_spec("pyarrow") is not None


def encode(table: pd.DataFrame, suffix: str) -> bytes:
    """Return a table as the content of a file.

    Args:
        table: Table.
        suffix: ``parquet`` or ``csv``.

    Raises:
        OSError: If Parquet is requested without pyarrow.
    """
    if suffix == "csv":
        return table.to_csv(index=False).encode()
    _require_pyarrow()
    buffer = io.BytesIO()
    filled = table.fillna({name: "" for name in TEXT_COLUMNS if name in table})
    typed = filled.astype({name: _column_type(filled[name]) for name in filled.columns})
    typed.to_parquet(buffer, index=False, engine="pyarrow")
    return buffer.getvalue()


def _column_type(column: pd.Series) -> str:
    """Return the type of a column, which must be equal in all files: a column without values contains numbers.

    A setting with numbers and other values, which have different structures and thus different files, is text.
    """
    if column.name in TEXT_COLUMNS:
        return "str"
    if column.isna().all():
        return "float64"
    inferred = str(column.infer_objects().dtype)
    return "str" if inferred == "object" else inferred


def _read_part(file: Path, columns: Collection[str] | None) -> pd.DataFrame:
    """Return the rows of one file."""
    content = io.BytesIO(bounded_read.read_bytes(file, MAX_PART_BYTES))
    try:
        if file.suffix == ".csv":
            found = pd.read_csv(content, dtype=object, keep_default_na=False)
            found = found[[name for name in found if columns is None or name in columns]].transform(_parse_column)
        else:
            _require_pyarrow()
            found = _read_parquet(content, columns)
        if "id" not in found:
            raise ValueError("it has no column id")
    except (ValueError, KeyError) as error:  # pyarrow's errors of format are ValueError
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise OSError(f"{file} is damaged ({reason}): remove it, and its flights are simulated again") from None
    return found


def _parse_column(column: pd.Series) -> pd.Series:
    """Return a column of texts with its type; NumPy parses numbers exactly, other than pandas."""
    if column.name in TEXT_COLUMNS:
        return column
    if column.name == "complete":
        return column == "True"
    try:
        return (
            column.astype("int64") if column.name in ("sample", "seed") else column.replace("", "nan").astype("float64")
        )
    except ValueError:  # settings that are no numbers
        return column


def _read_parquet(content: io.BytesIO, columns: Collection[str] | None) -> pd.DataFrame:
    """Return the columns of a Parquet file that exist."""
    from pyarrow import parquet

    file = parquet.ParquetFile(content)
    chosen = None if columns is None else [name for name in file.schema_arrow.names if name in columns]
    return file.read(chosen, use_threads=False).to_pandas()


def _require_pyarrow() -> None:
    """Raise OSError without pyarrow."""
    if not has_pyarrow():
        raise OSError(f"Parquet files require pyarrow: {extras.install_command('campaign')}")
