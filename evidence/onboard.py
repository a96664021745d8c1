"""Controller step as C on other processors: commands of a simulated C3 on x86-64, aarch64 and a bare Cortex-M7.

The program of `colift export c` replays 2000 ticks of the paper's C3 with the model learned in 20 s. Times of a step,
median and 99.9th percentile over 60 s, are from this machine on one core; times in an emulator are not meaningful.
Requirements besides a C compiler: aarch64-linux-gnu-gcc, qemu-aarch64, arm-none-eabi-gcc with newlib, qemu-system-arm
(Debian: gcc-aarch64-linux-gnu, qemu-user, gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm).
"""

from __future__ import annotations

import functools
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from colift import scenario
from colift.closed_loop.flight import run_experiment
from colift.codegen import build
from colift.integrations import c_export
from colift.scenario import experiment
from evidence import collect

TICKS, REPEATS = 2000, 15  # 30000 ticks of 2 ms are 60 s
EXACT, SINGLE = 1e-12, 1e-2
MEDIAN_US, P999_US = 100.0, 250.0
WORK = tempfile.TemporaryDirectory()
PLAIN = ("-std=c99", "-O2", "-ffp-contract=off", "-Wno-psabi")
START = """
#include <stdint.h>
extern uint32_t stack_top;
extern void _start(void);
void reset(void) {
  *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* the floating-point unit */
  __asm volatile("dsb\\n isb");
  _start();
}
void fault(void) { for (;;) *(volatile int *)0xFFFFFFF0 = 0; }
__attribute__((section(".vectors"), used)) void *vectors[] = {&stack_top, reset, fault, fault};
"""
LAYOUT = """
ENTRY(reset)
MEMORY { code (rx) : ORIGIN = 0, LENGTH = 4M
         data (rw) : ORIGIN = 0x60000000, LENGTH = 16M }
SECTIONS {
  .vectors : { KEEP(*(.vectors)) } > code
  .text : { *(.text*) *(.init) *(.fini) *(.rodata*) } > code
  .exidx : { *(.ARM.exidx*) } > code
  .init_array : { __init_array_start = .; KEEP(*(.init_array*)) __init_array_end = .; } > code
  .data : { *(.data*) } > data
  .bss : { __bss_start__ = .; *(.bss*) *(COMMON) __bss_end__ = .; } > data
  end = .;
  __end__ = .;
  stack_top = ORIGIN(data) + LENGTH(data);
}
"""


@functools.cache
def exported() -> Path:
    """Return the folder of the exported C3 of the paper, exported once."""
    folder = Path(WORK.name)
    settings = scenario.load_scenario("paper")
    case_experiment = experiment.make_experiment(settings, "C3")
    flight = run_experiment(case_experiment)
    assert not flight.termination_reason
    c_export.export_c(case_experiment, flight.model, TICKS, folder, "paper, C3")
    return folder


def build_and_replay(
    run: list[str], command: str, flags: list[str], repeats: int, sources: tuple[str, ...] = ()
) -> Any:
    """Build with a compiler, run, and read the output of the replay."""
    needed = [name for name in (command, run[0]) if name != "{program}"]
    if missing := [name for name in needed if shutil.which(name) is None]:
        raise SystemExit(f"onboard: {', '.join(missing)} not found; see the head of evidence/onboard.py")
    folder = exported()
    with tempfile.TemporaryDirectory() as made:
        program = Path(made) / "replay"
        parts = [str(folder / f"{name}.c") for name in ("colift", "learned", "replay")]
        subprocess.run([command, *flags, *parts, *sources, "-o", str(program), "-lm"], check=True)
        size = subprocess.run(["size", str(program)], capture_output=True, text=True, check=True).stdout.split()
        words = [part.format(program=program, flight=folder / "flight.bin", repeats=repeats) for part in run]
        output = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found = {name: float(value) for name, value in (line.split() for line in output.splitlines())}
    return found | {"code_bytes": int(size[6]), "compiler": version(command), "flags": " ".join(flags[:6])}


def version(command: str) -> str:
    return subprocess.run([command, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


def replay_on(target: str) -> dict[str, Any]:
    """Return the output of the replay on one target."""
    here, program = build.require_compiler()[0], ["{program}", "{flight}", "{repeats}"]
    with tempfile.TemporaryDirectory() as made:
        match target:
            case "x86-64":
                return build_and_replay(program, here, [*PLAIN], REPEATS)
            case "x86-64, AVX2":
                return build_and_replay(program, here, [*PLAIN, "-mavx2"], REPEATS)
            case "x86-64, one lane":
                return build_and_replay(program, here, [*PLAIN, "-DONE_LANE"], REPEATS)
            case "x86-64, contracted":
                return build_and_replay(
                    program, here, ["-std=c99", "-O3", "-march=native", "-ffp-contract=fast"], REPEATS
                )
            case "x86-64, single precision":
                return build_and_replay(program, here, [*PLAIN, "-DCOLIFT_FLOAT32"], REPEATS)
            case "aarch64":
                return build_and_replay(["qemu-aarch64", *program], "aarch64-linux-gnu-gcc", [*PLAIN, "-static"], 1)
        start, layout = Path(made) / "initial_state.c", Path(made) / "layout.ld"
        start.write_text(START)
        layout.write_text(LAYOUT)
        run = ["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-semihosting-config"]
        run += ["enable=on,target=native,arg=replay,arg={flight},arg={repeats}", "-kernel", "{program}"]
        core = ["-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "--specs=rdimon.specs"]
        return build_and_replay(run, "arm-none-eabi-gcc", [*PLAIN, *core, "-T", str(layout)], 1, (str(start),))


TARGETS = (
    "x86-64",
    "x86-64, AVX2",
    "x86-64, one lane",
    "x86-64, contracted",
    "x86-64, single precision",
    "aarch64",
    "Cortex-M7",
)


def main() -> bool:
    """Commands of every target must agree with Python's to 1e-12, or 1e-2 in single precision, within the time
    limit.
    """
    found = collect("onboard", TARGETS, replay_on)
    for target, row in found.items():
        sizes = [row[f"{what}_bytes"] / 1e3 for what in ("code", "state", "model")]
        print(
            f"{target:<26} largest difference {row['max_difference']:.2g} (relative "
            f"{row['max_relative_difference']:.2g}), step {row['step_time_median_us']:.0f} us, "
            f"99.9 % {row['step_time_p999_us']:.0f} us; "
            f"kB of code, state, model: {', '.join(f'{x:.0f}' for x in sizes)}"
        )
    alike = [target for target in TARGETS if target not in ("x86-64, contracted", "x86-64, single precision")]
    exact = [found[target]["max_relative_difference"] <= EXACT for target in alike]
    fast = (
        found["x86-64, AVX2"]["step_time_median_us"] <= MEDIAN_US
        and found["x86-64, AVX2"]["step_time_p999_us"] <= P999_US
    )
    return all(exact) and fast and found["x86-64, single precision"]["max_relative_difference"] <= SINGLE


if __name__ == "__main__":
    main()
