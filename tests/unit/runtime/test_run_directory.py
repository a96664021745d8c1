"""Folder of results: exchanged by one rename, of one run, locked for one process, without changes to other files."""

from __future__ import annotations

import errno
import io
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from colift.runtime import atomic_write, run_directory, signals
from colift.workflows import study

A, B = (run_directory.run_id("0.1.0", digest) for digest in ("seed 1", "seed 2"))
NAMES = study.STUDY_FILES + study.CERTIFICATE_FILES


def fill(path: Path, run: str, names: tuple[str, ...]) -> None:
    path.mkdir(exist_ok=True)
    for name in names:
        (path / name).write_text(f"of the run {run}.\n")


def names(path: Path) -> set[str]:
    return {file.name for file in path.iterdir()} if path.exists() else set()


def contents(path: Path) -> dict[str, str]:
    return {file.name: file.read_text() for file in path.iterdir()}


def lock_of(target: Path) -> Path:
    return target.parent / f".{target.name}{run_directory.LOCK_SUFFIX}"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Folder of results that does not exist yet."""
    return tmp_path / "out"


def write(out: Path, run: str, name: str, replace: bool = False) -> None:
    with run_directory.stage_run_directory(out, run, NAMES, replace=replace) as folder:
        atomic_write.write_atomic(folder.path / name, f"new, of the run {run}.\n".encode())


def end_with(error: type[BaseException], out: Path, **options: bool) -> None:
    with run_directory.stage_run_directory(out, A, NAMES, **options) as folder:
        (folder.path / "C2.nc").write_text(A)
        raise error


def test_runs_of_other_settings_or_versions_have_other_ids():
    ids = {run_directory.run_id(version, digest) for version in ("0.1.0", "0.2.0") for digest in ("a", "b")}
    assert len(ids) == 4
    assert all(run_directory.RUN_ID_PATTERN.fullmatch(name.encode()) for name in ids)
    assert run_directory.run_id("0.1.0", "a") == run_directory.run_id("0.1.0", "a")


# Contents -------------------------------------------------------------------------------------------------------------


def test_files_of_the_same_run_are_kept(out: Path):
    fill(out, A, ("C1.nc", "certificate.json", "notes.md"))
    (out / "mine").mkdir()
    (out / "mine" / "data").write_text("data")
    write(out, A, "C2.nc")
    assert names(out) == {"C1.nc", "C2.nc", "certificate.json", "notes.md", "mine"}
    assert (out / "mine" / "data").read_text() == "data"
    assert names(out.parent) == {"out"}


def test_results_of_another_run_are_refused(out: Path):
    fill(out, B, ("C1.nc",))
    (out / "summary.json").write_text(json.dumps({"scenario": "beam", "seed": 3, "version": "0.1.0", "run": B}))
    before = contents(out)
    with pytest.raises(OSError, match=r"another run \(beam, seed 3, colift 0\.1\.0\).* by --replace"):
        write(out, A, "C1.nc")
    assert contents(out) == before
    assert names(out.parent) == {"out"}


@pytest.mark.parametrize("earlier", [A, B])
def test_replace_removes_results_and_keeps_other_files(out: Path, earlier: str):
    fill(out, earlier, ("C1.nc", "integral.nc", "figure_1_tracking.pdf", "certificate.json"))
    fill(out, B, ("notes.md", "figure_10_mine.pdf", "C9.nc"))
    write(out, A, "C2.nc", replace=True)
    assert names(out) == {"C2.nc", "notes.md", "figure_10_mine.pdf", "C9.nc"}


def test_a_reserved_name_without_a_run_id_is_refused(out: Path):
    fill(out, A, ("C1.nc",))
    (out / "summary.json").write_text("{}")
    with pytest.raises(OSError, match=r"contains summary\.json, which colift did not write"):
        write(out, A, "C2.nc", replace=True)
    assert names(out) == {"C1.nc", "summary.json"}


def test_the_target_is_unchanged_until_the_block_ends(out: Path):
    fill(out, A, ("C1.nc",))
    with run_directory.stage_run_directory(out, A, NAMES) as folder:
        atomic_write.write_atomic(folder.path / "C1.nc", f"new {A}".encode())
        assert contents(out) == {"C1.nc": f"of the run {A}.\n"}
    assert contents(out) == {"C1.nc": f"new {A}"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, signals.Interrupted])
def test_an_error_in_the_block_leaves_the_target(out: Path, error: type[BaseException]):
    fill(out, A, ("C1.nc",))
    with pytest.raises(error):
        end_with(error, out)
    assert names(out) == {"C1.nc"}
    assert names(out.parent) == {"out"}


def test_partial_results_are_kept_on_request(out: Path):
    with pytest.raises(signals.Interrupted):
        end_with(signals.Interrupted, out, keep_on_interrupt=True)
    assert names(out) == {"C2.nc"}


def test_partial_results_do_not_replace_those_of_another_run(out: Path):
    fill(out, B, ("C1.nc",))
    with pytest.raises(signals.Interrupted):
        end_with(signals.Interrupted, out, keep_on_interrupt=True, replace=True)
    assert names(out) == {"C1.nc"}


def test_written_files_are_those_of_the_command(out: Path):
    fill(out, A, ("C1.nc", "C2.nc"))
    with run_directory.stage_run_directory(out, A, NAMES) as folder:
        for name in ("C2.nc", "C3.nc"):
            atomic_write.write_atomic(folder.path / name, A.encode())
        assert run_directory.written_files(folder, NAMES) == ["C2.nc", "C3.nc"]


def test_without_exchange_two_renames_are_used(out: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(run_directory, "_exchange", lambda first, second: False)
    fill(out, A, ("C1.nc",))
    write(out, A, "C2.nc")
    assert names(out) == {"C1.nc", "C2.nc"}
    assert names(out.parent) == {"out"}


def test_a_process_killed_between_two_renames_loses_nothing(out: Path):
    fill(out.parent / ".out.previous", A, ("C1.nc",))
    fill(out.parent / ".out.123.new", A, ("C1.nc", "C2.nc"))
    write(out, A, "C3.nc")
    assert names(out) == {"C1.nc", "C3.nc"}
    assert names(out.parent) == {"out"}


def test_hidden_folders_of_other_targets_are_kept(out: Path):
    """The name of the hidden folder of `out.5` begins with that of `out` and a number."""
    with run_directory.stage_run_directory(out.with_name("out.5"), A, NAMES) as other:
        (other.path / "C1.nc").write_text(A)
        write(out, A, "C1.nc")
    assert names(out.with_name("out.5")) == names(out) == {"C1.nc"}


def test_partial_files_of_killed_processes_are_removed(out: Path):
    fill(out, A, (".C1.nc.123.part", ".mine.part", "C1.nc.123.part"))
    write(out, A, "C3.nc")
    assert names(out) == {".mine.part", "C1.nc.123.part", "C3.nc"}


@pytest.mark.parametrize("name", ["out", "out/below"])
def test_a_file_in_place_of_a_folder_is_reported(tmp_path: Path, name: str):
    (tmp_path / "out").write_text("")
    with pytest.raises(OSError, match=r"cannot write to .*a file, not a folder"):
        write(tmp_path / name, A, "C1.nc")


def test_the_current_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """An exchange would leave the user's shell in a removed folder."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OSError, match="contains the current folder"):
        write(Path(), A, "C1.nc")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write to any folder")
def test_a_folder_without_write_permission_is_reported(out: Path):
    out.parent.chmod(0o500)
    with pytest.raises(OSError, match=r"cannot write to .*: Permission denied"):
        write(out, A, "C1.nc")


class Failure:
    """Makes the n-th call of the file system that can fail on a full disk raise `OSError`."""

    CALLS = ("open", "mkdir", "link", "rename", "replace", "fsync", "unlink", "rmdir")

    def __init__(self, monkeypatch: pytest.MonkeyPatch, number: int, root: Path):
        self.left, self.root = number, str(root)
        for call in self.CALLS:
            monkeypatch.setattr(os, call, self.failing(getattr(os, call)))
        monkeypatch.setattr(io, "open", self.failing(io.open))

    def failing(self, call):
        def wrapper(first, *args, **kwargs):
            if isinstance(first, int) or self.root in os.fspath(first):
                self.left -= 1
                if self.left == 0:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return call(first, *args, **kwargs)

        return wrapper


def test_a_failing_call_leaves_old_or_new_results_whole(tmp_path: Path):
    """Every call of the file system fails in turn; the folder then contains all earlier or all new results."""
    failed, number = 0, 0
    while True:
        number += 1
        out = tmp_path / str(number) / "out"
        out.parent.mkdir()
        fill(out, A, ("C1.nc", "summary.json"))
        earlier = contents(out)
        with pytest.MonkeyPatch.context() as monkeypatch:
            failure = Failure(monkeypatch, number, tmp_path)
            message = ""
            try:
                with run_directory.stage_run_directory(out, A, NAMES) as folder:
                    for name in ("C1.nc", "C2.nc", "summary.json"):
                        atomic_write.write_atomic(folder.path / name, f"new {A}".encode())
            except OSError as error:
                message = str(error)
        new = dict.fromkeys(("C1.nc", "C2.nc", "summary.json"), f"new {A}")
        assert contents(out) in ((earlier, new) if message else (new,))
        assert "\n" not in message
        lock_of(out).unlink(missing_ok=True)  # the next command does this after the end of this process
        write(out, A, "C3.nc")
        assert names(out.parent) == {"out"}
        if failure.left > 0:
            break
        failed += bool(message)
    assert failed > 10


# The lock -------------------------------------------------------------------------------------------------------------


def hold(out: Path, **changed: object) -> None:
    """Leave a lock as this process would, except for the given entries."""
    owner = {"host": socket.gethostname(), "pid": os.getpid(), "began": run_directory._start_time(os.getpid())}
    lock_of(out).write_text(json.dumps({**owner, "since": 0} | changed))


def test_two_processes_cannot_write_to_one_folder(out: Path):
    with run_directory.stage_run_directory(out, A, NAMES):
        with pytest.raises(BlockingIOError, match=rf"is in use: process {os.getpid()} on ") as caught:
            write(out, A, "C1.nc")
        assert "\n" not in str(caught.value)
        assert lock_of(out).exists()
    assert names(out.parent) == {"out"}


def test_the_lock_of_an_ended_process_is_removed(out: Path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    # the number of the process may be in use again: then it began at another time
    for changed in ({"pid": ended.pid}, {"pid": 2**40}, {"began": "1"}):
        hold(out, **changed)
        with run_directory.stage_run_directory(out, A, NAMES):
            assert json.loads(lock_of(out).read_text())["pid"] == os.getpid()
        assert not lock_of(out).exists()


def test_a_lock_that_could_not_be_removed_is_not_held(out: Path, monkeypatch: pytest.MonkeyPatch):
    """The next run in the same process removes it."""

    def fail(_path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as failing, run_directory.stage_run_directory(out, A, NAMES):
        failing.setattr(Path, "unlink", fail)
    assert lock_of(out).exists()
    write(out, A, "C1.nc")
    assert names(out.parent) == {"out"}


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the start time of a process is unavailable")
def test_a_zombie_process_does_not_hold_the_lock(out: Path):
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        hold(out, pid=process.pid, began=run_directory._start_time(process.pid))
        with pytest.raises(BlockingIOError, match="in use"):
            write(out, A, "C1.nc")
        assert process.stdin
        process.stdin.write(b"\n")
        process.stdin.close()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        write(out, A, "C1.nc")


OWNER = b'{"host": "elsewhere", "pid": 1, "began": "", "since": 0}'


@pytest.mark.parametrize(
    "content",
    [
        *(b"", b"{", b"[]", b"{}", b'{"pid": "me"}', b"\xff", b"[" * 4000),
        *(OWNER.replace(b": 1,", b": %s," % pid) for pid in (b"Infinity", b"-1")),
        *(OWNER.replace(b": 0}", b": %s}" % since) for since in (b"1e300", b"NaN")),
        *(OWNER.replace(b"where", b"%s" % host) for host in (b"\\n", b"\\ud800")),
    ],
)
def test_a_lock_without_an_owner_is_removed(out: Path, content: bytes, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(time, "sleep", lambda _: None)
    lock_of(out).write_bytes(content)
    write(out, A, "C1.nc")
    assert names(out.parent) == {"out"}


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (os.mkfifo, "a pipe, socket or device, not a regular file"),
        (Path.mkdir, "a folder, not a file"),
        (lambda lock: lock.symlink_to("/dev/zero"), "a link, not a lock file of colift: remove it"),
        (lambda lock: lock.symlink_to("missing"), "a link, not a lock file of colift: remove it"),
        (lambda lock: lock.write_bytes(bytes(2**20)), "larger than"),
    ],
)
def test_a_lock_that_colift_did_not_create_is_refused(out: Path, make: Callable[[Path], object], reason: str):
    make(lock_of(out))
    with pytest.raises(OSError, match=reason) as caught:
        write(out, A, "C1.nc")
    assert caught.value.filename == str(lock_of(out))
    assert names(out.parent) == {lock_of(out).name}


def test_a_pipe_in_place_of_the_own_lock_is_left(out: Path):
    with run_directory.stage_run_directory(out, A, NAMES):
        lock_of(out).unlink()
        os.mkfifo(lock_of(out))
    assert names(out.parent) == {"out", lock_of(out).name}


def test_a_lock_of_another_computer_is_respected(out: Path):
    """The message names the lock file, which the user may remove."""
    hold(out, host="elsewhere", pid=1)
    with pytest.raises(OSError, match=r"process 1 on elsewhere .* if that process has ended, remove .*colift\.lock"):
        write(out, A, "C1.nc")
    assert lock_of(out).exists()


CONTEND = """
import os, sys, time
from pathlib import Path
from colift.runtime import run_directory
path, done = Path(sys.argv[1]), 0
while done < 25:
    killed = done % 5 == 4  # a process that ends without leaving the block: lock and hidden folder stay
    if killed and (child := os.fork()):
        os.waitpid(child, 0)
        done += 1
        continue
    try:
        with run_directory.stage_run_directory(path, "colift-run-000000000000", ()) as folder:
            inside = os.open(path.parent / "inside", os.O_CREAT | os.O_EXCL)  # fails if another is inside
            time.sleep(0.001)
            os.close(inside)
            (path.parent / "inside").unlink()
            if killed:
                os._exit(0)
            done += 1
    except BlockingIOError:
        if killed:
            os._exit(0)
        time.sleep(0.001)
print("done")
"""


def test_one_of_many_contending_processes_is_inside(out: Path):
    hold(out, began="1")
    crowd = [
        subprocess.Popen(
            [sys.executable, "-c", CONTEND, str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    outputs = [each.communicate(timeout=300) for each in crowd]
    assert outputs == [("done\n", "")] * 3
