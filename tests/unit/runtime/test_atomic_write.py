"""Tests of atomic writes: new files, file systems without hard links, and requests to end the process."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colift.runtime import atomic_write, signals


def refuse(*_: object, **__: object) -> None:
    raise PermissionError(1, "Operation not permitted")


@pytest.mark.parametrize("has_links", [True, False])
def test_a_new_file_replaces_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool):
    if not has_links:
        monkeypatch.setattr(os, "link", refuse)
    path = tmp_path / "tuned.yaml"
    atomic_write.write_atomic(path, b"first", new=True)
    with pytest.raises(FileExistsError, match=r"cannot write .*tuned\.yaml: File exists"):
        atomic_write.write_atomic(path, b"second", new=True)
    assert path.read_bytes() == b"first"
    assert [file.name for file in tmp_path.iterdir()] == ["tuned.yaml"]


def test_only_requested_files_are_written_after_an_interrupt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(signals, "_received", [2])
    with pytest.raises(signals.Interrupted):
        atomic_write.write_atomic(tmp_path / "a", b"a")
    atomic_write.write_atomic(tmp_path / "b", b"b", after_interrupt=True)
    assert [file.name for file in tmp_path.iterdir()] == ["b"]
