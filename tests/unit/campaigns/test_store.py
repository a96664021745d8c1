"""Files of a store: equal values after a round trip, and damaged files."""

from __future__ import annotations

import importlib.util
import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from colift.campaigns import flights, sampling, spec, store
from tests.support import campaigns

SUFFIXES = (
    "csv",
    pytest.param("parquet", marks=pytest.mark.skipif(not store.has_pyarrow(), reason="the extra is not installed")),
)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_rows_are_equal_after_a_round_trip(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(store, "has_pyarrow", lambda: suffix == "parquet")
    campaign = spec.load_campaign(campaigns.write(tmp_path, vary=campaigns.VARIED | {"control.K_v": [4, 4.5]}))
    planned = sampling.plan_flights(campaign)
    rows = [flights.identity(each) | {"complete": True, "termination_reason": "", "x": 1 / 3} for each in planned[:3]]
    rows.append(flights.lost_row(planned[3], "signal 9"))
    with store.open_store(tmp_path / "out") as opened:
        assert opened.add(rows[:2]).suffix == f".{suffix}"
        opened.add(rows[2:])
        found = opened.read()
        assert opened.stored_ids() == {each.id for each in planned[:4]}
    by_id = found.set_index("id")
    assert by_id.loc[[each.id for each in planned[:4]], "complete"].tolist() == [True, True, True, False]
    for row in rows:
        for name, value in row.items():
            if name != "id":
                assert by_id.loc[str(row["id"]), name] == value
    assert np.isnan(by_id.loc[planned[3].id, "x"])


@pytest.mark.skipif(not store.has_pyarrow(), reason="the extra is not installed")
def test_parquet_file_of_a_setting_with_numbers_and_texts():
    table = pd.DataFrame({"id": ["a", "b"], "settings.learning.fit_latency": [0.5, '"measured"']})
    found = pd.read_parquet(io.BytesIO(store.encode(table, "parquet")))
    assert found["settings.learning.fit_latency"].tolist() == ["0.5", '"measured"']


def test_rows_that_occur_twice_are_read_once(tmp_path: Path):
    campaign = spec.load_campaign(campaigns.write(tmp_path))
    rows = [flights.identity(each) | {"termination_reason": ""} for each in sampling.plan_flights(campaign)]
    with store.open_store(tmp_path / "out") as opened:
        opened.add(rows[:5])
        opened.add(rows[3:])
        assert len(opened.read()) == len(rows)


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n", b"PAR1"])
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_damaged_file_gives_one_line(suffix: str, content: bytes, tmp_path: Path):
    if suffix == "parquet" and importlib.util.find_spec("pyarrow") is None:
        message = r"Parquet files require pyarrow: .* -m pip install 'colift\[campaign\]'"
    else:
        message = rf"ab\.{suffix} is damaged \(.*\): remove it"
    with store.open_store(tmp_path / "out") as opened:
        (opened.parts / f"ab.{suffix}").write_bytes(content)
        with pytest.raises(OSError, match=message) as caught:
            opened.stored_ids()
    assert "\n" not in str(caught.value)


def test_unfinished_files_of_a_killed_process_are_removed(tmp_path: Path):
    with store.open_store(tmp_path / "out") as opened:
        (opened.parts / ".ab.csv.123.part").write_bytes(b"a")
    with store.open_store(tmp_path / "out") as opened:
        assert list(opened.parts.iterdir()) == []
        assert isinstance(opened.read(), pd.DataFrame)
