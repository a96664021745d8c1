"""Tests of the benchmark runner: list, refusals and result files."""

import json

import jax
import jax.numpy as jnp
import pytest

from benchmarks import NAMES, Outcome, __main__, cold_start, gpu, roofline, status, work_precision


def test_list_has_every_benchmark_with_its_summary(capsys):
    assert __main__.main(["--list"]) == 0
    listed = capsys.readouterr().out
    for name in NAMES:
        assert f"{name:<14} {__main__.title(name)}" in listed
        assert len(__main__.title(name)) > 20


def test_every_module_with_run_function_is_listed():
    modules = {p.stem for p in __main__.HERE.glob("*.py") if "def run(seconds: float) -> Outcome" in p.read_text()}
    assert modules == set(NAMES)


def test_unknown_benchmark_is_refused_with_known_names(capsys, tmp_path):
    assert __main__.main(["warp", "--results", str(tmp_path)]) == 2
    output = capsys.readouterr().err
    assert "no benchmark warp" in output
    assert "one_team" in output
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(jax.default_backend() == "gpu", reason="measures for real where there is a GPU")
def test_gpu_benchmark_without_gpu_writes_its_result(capsys, tmp_path):
    assert __main__.main(["gpu", "--results", str(tmp_path)]) == 0
    assert "no GPU was found" in capsys.readouterr().out
    (path,) = tmp_path.iterdir()  # and no temporary file beside it
    written = json.loads(path.read_text())
    assert path.name == "gpu.json"
    assert "no GPU was found" in written["omitted"][0]
    assert written["figures"] == {}
    assert {"date", "machine", "command", "versions", "commit", "uncommitted", "files"} <= written.keys()
    assert written["versions"]["jax"] == jax.__version__


def test_missed_target_is_printed_and_sets_exit_status(capsys, monkeypatch, tmp_path):
    found = Outcome({"took": 2.0}, {"took 2 s, under 1 s": False, "took 2 s, under 3 s": True})
    monkeypatch.setattr(cold_start, "run", lambda seconds: found)
    assert __main__.main(["cold_start", "--results", str(tmp_path)]) == 1
    output = capsys.readouterr().out
    assert "MISSED took 2 s, under 1 s" in output
    assert "met    took 2 s, under 3 s" in output
    assert "1 targets missed" in output
    assert json.loads((tmp_path / "cold_start.json").read_text())["targets"] == found.targets


@pytest.mark.long
def test_gpu_program_runs_on_cpu():
    found = gpu.measure(jax.devices()[0], (1, 2), steps=2, seconds=0.0)
    assert set(found) == {"1", "2"}
    assert all(rate > 0 for rate in found.values())


def test_operation_count_includes_loops():
    """Operations in loop bodies count once per iteration, and unused operations do not count."""

    def f(x):
        unused = jnp.sqrt(x)
        del unused
        total, _ = jax.lax.scan(lambda s, _: (s * x + 1.0, None), x, None, length=5)
        return total / x - jnp.sin(x)

    counted = roofline.operations(f, jnp.array(2.0))
    assert counted == {"mul": 5, "add": 5, "div": 1, "sub": 1, "sincos": 1}


def test_stored_results_are_current():
    """`./dev bench NAME` on the machine of the other results computes a result again."""
    assert {name: reasons for name, reasons in status.reasons_behind().items() if reasons} == {}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"machine": "another"}, "machine another instead of "),
        ({"versions": {"colift": "0.0.1"}}, "colift 0.0.1 instead of "),
        ({"versions": {"jax": "0.1"}}, "jax 0.1 instead of "),
        ({"files": {"benchmarks/one_team.py": "0" * 40}}, "benchmarks/one_team.py changed"),
        (None, "no result"),
    ],
)
def test_result_behind_is_named_with_reason(change, reason, tmp_path, capsys):
    for path in status.RESULTS.glob("*.json"):
        content = json.loads(path.read_text())
        if path.stem == "one_team":
            if change is None:
                continue
            content |= change
        (tmp_path / path.name).write_text(json.dumps(content))
    assert any(text.startswith(reason) for text in status.reasons_behind(tmp_path)["one_team"])
    assert __main__.main(["--status", "--results", str(tmp_path)]) == 1
    assert reason in capsys.readouterr().out


def test_time_at_error_interpolates_logarithms():
    points = [{"error_m": 1e-4, "cpu_us_per_s": 10.0}, {"error_m": 1e-8, "cpu_us_per_s": 1000.0}]
    assert work_precision.time_at({"a": points}, "a", 1e-6) == pytest.approx(100.0)
    assert work_precision.time_at({"a": points}, "a", 1e-10) == pytest.approx(1e4)
    floor = [{"error_m": 2e-3, "cpu_us_per_s": 1.0}, {"error_m": 2e-3, "cpu_us_per_s": 2.0}]
    assert work_precision.time_at({"a": points, "a b": floor}, "a", 1e-6) == pytest.approx(100.0)


@pytest.mark.parametrize(("old", "new", "behind"), [('"gpu",', '"gpu", "new",', False), ("perf_counter", "time", True)])
def test_a_change_of_the_measurement_makes_results_behind(tmp_path, old, new, behind):
    """An addition to the list of names does not."""
    (tmp_path / "benchmarks").mkdir()
    for path in ("requirements", "pyproject.toml", "benchmarks/gp.py"):
        (tmp_path / path).symlink_to(status.ROOT / path)
    text = (status.ROOT / status.MEASUREMENT).read_text()
    assert old in text
    (tmp_path / status.MEASUREMENT).write_text(text.replace(old, new))
    reasons = status.reasons_behind(root=tmp_path)["gp"]
    assert (f"{status.MEASUREMENT} changed" in reasons) == behind
