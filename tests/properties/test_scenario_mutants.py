"""Tests that mutated scenario files are either accepted or rejected with their lines, in bounded time and without
another exception.
"""

import re
import resource
import signal

import pytest

from colift import scenario
from colift.scenario import Scenario, ScenarioError
from tests.support.scenario_mutants import mutant

EACH = 40
HANG = 60.0  # s of processor time per file; the slowest of thousands took 1 s, so this detects a hang
MEMORY = 500_000  # kB


@pytest.fixture
def alarm():
    """Stop a test that does not terminate."""

    def stop(*_: object) -> None:
        pytest.fail(f"not read within {HANG:g} s of processor time", pytrace=False)

    before = signal.signal(signal.SIGPROF, stop)
    yield lambda: signal.setitimer(signal.ITIMER_PROF, HANG)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.signal(signal.SIGPROF, before)


@pytest.mark.parametrize("first", range(0, 4 * EACH, EACH))
def test_mutated_file_is_accepted_or_refused_with_lines(first, tmp_path, alarm):
    path, refused = tmp_path / "mine.yaml", 0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for seed in range(first, first + EACH):
        path.write_bytes(mutant(seed))
        alarm()
        try:
            assert isinstance(scenario.load_scenario(path), Scenario)
        except ScenarioError as error:
            refused += 1
            lines = str(error).splitlines()
            reported = [line for line in lines if re.match(rf"{re.escape(str(path))}:[1-9]\d*: \S", line)]
            assert reported, seed
            assert len(lines) - len(reported) <= lines[-1].startswith("and "), (seed, lines)
            assert len(str(error)) < 100_000, seed
            str(error).encode()  # can be printed
    assert refused > EACH // 4  # the mutants are broken
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY
