"""Tests of run directories: files of one run, one writing process at a time, foreign files untouched."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from colift.runtime import run_directory, signals
from colift.workflows import study

A, B = (run_directory.run_id("0.1.0", digest) for digest in ("seed 1", "seed 2"))
NAMES = study.STUDY_FILES + study.CERTIFICATE_FILES


def fill(path: Path, run: str, names: tuple[str, ...]) -> None:
    for name in names:
        (path / name).write_text(f"of the run {run}.\n")


def names(path: Path) -> set[str]:
    return {file.name for file in path.iterdir()}


def test_run_id_depends_on_settings_and_version():
    made = {run_directory.run_id(version, digest) for version in ("0.1.0", "0.2.0") for digest in ("a", "b")}
    assert len(made) == 4
    assert all(run_directory.RUN_ID_PATTERN.fullmatch(name.encode()) for name in made)
    assert run_directory.run_id("0.1.0", "a") == run_directory.run_id("0.1.0", "a")


@pytest.mark.parametrize("before", [A, B])
def test_run_replaces_its_kind_and_other_runs(tmp_path: Path, before: str):
    flown, certified = ("C1.nc", "integral.nc", "figure_1_tracking.pdf", "summary.json"), ("certificate.json",)
    fill(tmp_path, before, flown + certified)
    mine = {"notes.md", "figure_9_mine.pdf", "C9.nc"}
    fill(tmp_path, B, tuple(mine))
    with run_directory.lock_run_directory(tmp_path, A, NAMES) as out:
        run_directory.remove_stale_files(out, study.STUDY_FILES, study.CERTIFICATE_FILES)
        assert names(tmp_path) - {run_directory.LOCK_FILE} == mine | (set(certified) if before == A else set())
    with run_directory.lock_run_directory(tmp_path, B, NAMES) as out:
        run_directory.remove_stale_files(out, study.CERTIFICATE_FILES, study.STUDY_FILES)
    assert names(tmp_path) == mine


def test_foreign_file_is_refused(tmp_path: Path):
    """A file that colift did not write is refused, and nothing is changed."""
    fill(tmp_path, B, ("C1.nc",))
    (tmp_path / "summary.json").write_text("{}")
    with (
        pytest.raises(OSError, match=r"contains summary\.json, which colift did not write"),
        run_directory.lock_run_directory(tmp_path, A, NAMES),
    ):
        pass
    assert names(tmp_path) == {"C1.nc", "summary.json"}


def test_path_of_a_file_is_refused(tmp_path: Path):
    (tmp_path / "out").write_text("")
    with (
        pytest.raises(OSError, match=r"cannot write to .*out: it is a file, not a folder"),
        run_directory.lock_run_directory(tmp_path / "out", A, NAMES),
    ):
        pass


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder_is_refused(tmp_path: Path):
    tmp_path.chmod(0o500)
    with pytest.raises(OSError, match=r"cannot write to .*: Permission denied"):
        run_directory.lock_run_directory(tmp_path, A, NAMES).__enter__()


# The lock -------------------------------------------------------------------------------------------------------------


def write_lock(path: Path, **changed: object) -> None:
    """Write a lock file of this process with some entries changed."""
    me = {"host": socket.gethostname(), "pid": os.getpid(), "began": run_directory._start_time(os.getpid()), "since": 0}
    (path / run_directory.LOCK_FILE).write_text(json.dumps(me | changed))


def test_second_writer_is_refused(tmp_path: Path):
    with run_directory.lock_run_directory(tmp_path, A, NAMES):
        with pytest.raises(BlockingIOError, match=rf"is in use: process {os.getpid()} on ") as caught:
            run_directory.lock_run_directory(tmp_path, A, NAMES).__enter__()
        assert "\n" not in str(caught.value)
        assert names(tmp_path) == {run_directory.LOCK_FILE}
    assert names(tmp_path) == set()


def test_lock_is_released_after_any_exit(tmp_path: Path):
    for error in (ValueError, KeyboardInterrupt, signals.Interrupted):
        with pytest.raises(error), run_directory.lock_run_directory(tmp_path, A, NAMES):
            raise error
        assert names(tmp_path) == set()


def test_lock_of_ended_process_is_taken_over(tmp_path: Path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    # the process id may have been reused; then the start time differs
    for changed in ({"pid": ended.pid}, {"pid": 2**40}, {"began": "1"}):
        write_lock(tmp_path, **changed)
        with run_directory.lock_run_directory(tmp_path, A, NAMES):
            assert json.loads((tmp_path / run_directory.LOCK_FILE).read_text())["pid"] == os.getpid()
        assert names(tmp_path) == set()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system does not say when a process began")
def test_zombie_process_counts_as_ended(tmp_path: Path):
    """A process that has ended but was not waited for counts as ended."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        write_lock(tmp_path, pid=process.pid, began=run_directory._start_time(process.pid))
        with pytest.raises(BlockingIOError, match="in use"):
            run_directory.lock_run_directory(tmp_path, A, NAMES).__enter__()
        assert process.stdin
        process.stdin.write(b"\n")
        process.stdin.close()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with run_directory.lock_run_directory(tmp_path, A, NAMES):
            pass


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b'{"pid": "me"}', b"\xff"])
def test_invalid_lock_is_taken_over(tmp_path: Path, content: bytes):
    (tmp_path / run_directory.LOCK_FILE).write_bytes(content)
    with run_directory.lock_run_directory(tmp_path, A, NAMES):
        pass
    assert names(tmp_path) == set()


def test_lock_of_another_host_is_respected(tmp_path: Path):
    """A lock of another host is respected, and the message states how to remove it."""
    write_lock(tmp_path, host="elsewhere", pid=1)
    with pytest.raises(OSError, match=r"process 1 on elsewhere .* if that process has ended, remove .*colift\.lock"):
        run_directory.lock_run_directory(tmp_path, A, NAMES).__enter__()
    assert names(tmp_path) == {run_directory.LOCK_FILE}


def test_temporary_files_of_killed_processes_are_removed(tmp_path: Path):
    for name in (".C1.nc.123.part", ".mine.part", "C1.nc.123.part"):
        (tmp_path / name).write_text("")
    with run_directory.lock_run_directory(tmp_path, A, NAMES):
        pass
    assert names(tmp_path) == {".mine.part", "C1.nc.123.part"}


CONTEND = """
import os, sys, time
from pathlib import Path
from colift.runtime import run_directory
path, done = Path(sys.argv[1]), 0
while done < 25:
    try:
        with run_directory.lock_run_directory(path, "colift-run-000000000000", ()):
            inside = os.open(path / "inside", os.O_CREAT | os.O_EXCL)  # fails if another is inside
            time.sleep(0.001)
            os.close(inside)
            (path / "inside").unlink()
            done += 1
            if done % 5 == 0:  # killed: the lock remains and names no running process
                lock = path / run_directory.LOCK_FILE
                lock.write_text(lock.read_text().replace('"pid": ', '"pid": 9999999'))
    except BlockingIOError:
        time.sleep(0.001)
print("done")
"""


def test_concurrent_takeover_has_one_winner(tmp_path: Path):
    """Of many processes that contend for a folder with a stale lock, one at a time is inside."""
    write_lock(tmp_path, began="1")
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", CONTEND, str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    outputs = [each.communicate(timeout=300) for each in processes]
    assert outputs == [("done\n", "")] * 3
