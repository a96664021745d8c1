"""What flies as C: the pilot's tick in C99 without allocation, threads or libraries but the math library.

The code is made from the same JAX functions as native flights, for one sample. What was learned is a block of constants
of its own, behind a pointer, so that an update on board is an assignment. A program replays a flight that was flown
here and compares the commands. Not flown on hardware.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift import codegen
from colift.closed_loop import flight, simulator
from colift.models.measurement import Measurement
from colift.models.state import ControlClock, TeamInputs
from colift.onboard.learning import residual_model
from colift.runtime import atomic_write

STACK = 1 << 40  # bytes: no array is allocated
LANES = 4  # agents, or points of a mean, side by side where a compiler has vectors: two doubles at once, or four
UNITS = {  # of the fields of readings and commands; an attitude has none
    "R": "",
    "p": "m",
    "x": "m",
    "v": "m/s",
    "omega": "rad/s, body frame",
    "a": "m/s^2, specific force, body frame",
    "r": "rad or m",
    "lam": "N, frame of the tip",
    "u": "N",
    "tau": "N m, body frame",
    "tau_r": "N m or N",
}


class ReplayData(NamedTuple):
    """Ticks of a flight as the pilot met them, time first."""

    t: Array  # s
    m: Measurement
    command: TeamInputs


def replay(
    experiment: flight.Experiment, model: residual_model.ResidualModel, ticks: int
) -> tuple[Measurement, ReplayData]:
    """The reading at rest before a flight with a frozen oracle, and the flight's first ticks."""
    setup = dataclasses.replace(
        experiment.loop_config, controller=dataclasses.replace(experiment.controller, residual_model=model)
    )
    noise = experiment.world.sample_noise(jax.random.key(experiment.seed), ticks)
    flown = jax.jit(codegen.compile(_flown))(setup, simulator.reset(setup, experiment.initial_state), noise)
    return experiment.world.measure_at_rest(experiment.initial_state), flown


def _flown(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any) -> ReplayData:
    def one(state: tuple[Any, Any], context: tuple[Array, Any]) -> tuple[tuple[Any, Any], ReplayData]:
        (world, controller_state), (t, drawn) = state, context
        clock = ControlClock(t=t, dt=setup.dt)
        m, world = setup.world.measure(world, clock, drawn)
        command, controller_state, _ = setup.controller.step(controller_state, m, clock)
        world, _ = setup.world.step(world, command, clock)
        return (world, controller_state), ReplayData(t=t, m=m, command=command)

    ticks = jax.tree.leaves(noise)[0].shape[0]
    t = jnp.arange(ticks, dtype=float) * setup.dt
    return jax.lax.scan(one, (loop.world, loop.controller), (t, noise))[1]


def export_c(
    experiment: flight.Experiment, model: residual_model.ResidualModel, ticks: int, folder: Path, name: str
) -> None:
    """Write the pilot with what it has learned, a replay of `ticks` ticks, and what builds and runs both.

    Raises OSError where the folder cannot be written, `native.UnsupportedPrimitive` for a part that calls what has no
    C, with its place.
    """
    controller, dt = experiment.controller, jnp.asarray(experiment.dt)
    rest, flown = replay(experiment, model, ticks)

    def begin(model: residual_model.ResidualModel, first: Measurement) -> tuple[TeamInputs, Any]:
        return dataclasses.replace(controller, residual_model=model).init(first, ControlClock(t=jnp.zeros(()), dt=dt))

    def step(
        model: residual_model.ResidualModel, t: Array, measurement: Measurement, state: Any
    ) -> tuple[TeamInputs, Any]:
        return dataclasses.replace(controller, residual_model=model).step(state, measurement, ControlClock(t=t, dt=dt))[
            :2
        ]

    command, state = jax.eval_shape(begin, model, rest)
    commands, before, own = (len(jax.tree.leaves(x)) for x in (command, (model, 0.0, rest), state))
    carried = [(commands + k, before + k) for k in range(own)]
    init = _traced(begin, (), model=model, measurement=rest)
    tick = _traced(step, carried, model=model, t=jnp.zeros(()), measurement=rest, state=state)
    structs = {
        "model": CStruct(model, "what was learned"),
        "measurement": CStruct(rest, "what is measured at one time"),
        "state": CStruct(state, "what the pilot remembers from tick to tick"),
        "command": CStruct({"agents": command}, "what vehicles are to do until the next tick"),
    }
    for of, k in (*init.arguments, *tick.arguments):
        if of in structs:
            structs[of].used.add(k)
    for of in ("state", "command"):
        structs[of].used |= {k for k, (_, shape) in enumerate(structs[of].leaves) if 0 not in shape}
    head = _header(name, structs, experiment.dt)
    about = f"/* {name}, by colift {version('colift')}. This file belongs to its user. */\n"
    initial_model = structs["model"].initializer(model)
    files = {
        "colift.h": about + head,
        "colift.c": about + _code(structs, init, tick),
        "learned.c": f'{about}#include "colift.h"\n\nconst colift_model colift_trained_model = {initial_model};\n',
        "replay.c": about + resources.files("colift.codegen").joinpath("replay.c").read_text(),
        "CMakeLists.txt": CMAKE,
    }
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in files.items():
        atomic_write.write_atomic(folder / file, text.encode())
    rows = np.concatenate(
        [
            np.asarray(flown.t)[:, None],
            structs["measurement"].rows(flown.m, ticks),
            structs["command"].rows(flown.command, ticks),
        ],
        axis=1,
    )
    first = np.concatenate([[0.0], structs["measurement"].rows(jax.tree.map(lambda x: x[None], rest), 1)[0]])
    first = np.pad(first, (0, rows.shape[1] - len(first)))
    atomic_write.write_atomic(folder / "flight.bin", np.concatenate([first[None], rows]).astype("<f8").tobytes())


class TracedKernel(NamedTuple):
    """A function as C, and its parameters: of which argument, and which leaf of it."""

    kernel: codegen.Kernel
    arguments: list[tuple[str, int]]


def _traced(f: Callable[..., Any], onto: Sequence[tuple[int, int]], **args: Any) -> TracedKernel:
    made = codegen.kernel(jax.make_jaxpr(f)(*args.values()), agent_lanes=LANES, stack_bytes=STACK, in_place_results=onto)
    leaves = [(of, k) for of, tree in args.items() for k in range(len(jax.tree.leaves(tree)))]
    return TracedKernel(kernel=made, arguments=[leaves[k] for k in made.arguments])


class CStruct:
    """A PyTree as a C struct: a member a leaf, named by its path; a number is a `colift_real`, whatever its type."""

    def __init__(self, tree: Any, about: str) -> None:
        self.about = about
        self.leaves = [(_name(path), leaf.shape) for path, leaf in jax.tree_util.tree_leaves_with_path(tree)]
        self.used: set[int] = set()

    def declaration(self, name: str) -> str:
        """The declaration, of the members that are used."""
        members = []
        for k in sorted(self.used):
            member, shape = self.leaves[k]
            unit = UNITS.get(re.split(r"_\d+_|payload_", member)[-1], "")
            said = ", ".join([unit] * bool(unit) + [" x ".join(map(str, shape))] * (len(shape) > 1))
            size = f"[{self.size(k)}]" if shape else ""
            members.append(f"  colift_real {member}{size};" + (f" /* {said} */" if said else ""))
        return f"/* {self.about} */\ntypedef struct {{\n" + "\n".join(members) + f"\n}} colift_{name};\n"

    def size(self, k: int) -> int:
        """Numbers of a leaf."""
        return int(np.prod(self.leaves[k][1]))

    def pointer(self, of: str, k: int) -> str:
        """To the first number of a leaf."""
        member, shape = self.leaves[k]
        return f"{of}->{member}" if shape else f"&{of}->{member}"

    def initializer(self, tree: Any) -> str:
        """A constant of this struct."""
        values = jax.tree.leaves(tree)
        parts = []
        for k in sorted(self.used):
            numbers = ", ".join(repr(float(x)) for x in np.asarray(values[k], float).ravel())
            parts.append(f"  .{self.leaves[k][0]} = " + (f"{{{numbers}}}" if self.leaves[k][1] else numbers))
        return "{\n" + ",\n".join(parts) + "\n}"

    def rows(self, tree: Any, time: int) -> np.ndarray:
        """`(time, numbers)`: its members in their order, of a PyTree with time first."""
        values = jax.tree.leaves(tree)
        return np.concatenate([np.asarray(values[k], float).reshape(time, -1) for k in sorted(self.used)], axis=1)


def _name(path: Sequence[Any]) -> str:
    """The path of a leaf as a name of C."""
    return re.sub(r"\W+", "_", jax.tree_util.keystr(tuple(path))).strip("_") or "value"


def _header(name: str, structs: dict[str, CStruct], dt: float) -> str:
    kinds = "\n".join(struct.declaration(of) for of, struct in structs.items())
    return f"""/*
 * The pilot of {name}. Made by colift from the functions that it flies; not flown on hardware.
 * SI units, z up; matrices by rows, agents in the order of the team. One call of colift_step every
 * {dt:g} s, with the time since the first. No function allocates, keeps a state of its own or calls
 * anything but the math library.
 */
#ifndef COLIFT_H
#define COLIFT_H

#ifdef __cplusplus
extern "C" {{
#endif

#ifdef COLIFT_FLOAT32
typedef float colift_real;
#else
typedef double colift_real;
#endif

{kinds}
#define COLIFT_PERIOD {dt!r} /* s */

extern const colift_model colift_trained_model; /* of the flight that this was made from */

/* The memory before the first tick and the command that holds the team until then, from a reading at rest. */
void colift_init(const colift_model *model, const colift_measurement *m, colift_state *state,
                 colift_command *command);

/* One tick: the command from now on. Returns 0, or 1 where a counter left the integers that are exact. */
int colift_step(const colift_model *model, colift_real t, const colift_measurement *m, colift_state *state,
                colift_command *command);

#ifdef __cplusplus
}}
#endif
#endif
"""


def _code(structs: dict[str, CStruct], init: TracedKernel, tick: TracedKernel) -> str:
    read = lambda name: resources.files("colift.codegen").joinpath(name).read_text()  # noqa: E731
    commands, state = len(structs["command"].leaves), structs["state"]
    begun = [state.pointer("state", k - commands) for k in init.kernel.results if k >= commands]
    moved = [k - commands for k in tick.kernel.results if k >= commands]  # what is not written to in place
    after = {k: f"next_{state.leaves[k][0]}" for k in moved}
    rooms = [f"colift_real {room}[{state.size(k)}];" for k, room in after.items()]
    moves = [f"memcpy({state.pointer('state', k)}, {room}, sizeof {room});" for k, room in after.items()]
    start, step = _call(structs, init, begun), _call(structs, tick, list(after.values()))
    return "\n".join([
        '#include "colift.h"\n',
        read("onboard.h"),
        codegen.lanes_h(sorted({*init.kernel.widths, *tick.kernel.widths})),
        re.sub(r"\bf(\d)", r"g\1", init.kernel.text),  # two kernels in one file
        "#undef PIECES\n#undef WHOLE",
        tick.kernel.text,
        "void colift_init(const colift_model *model, const colift_measurement *m, colift_state *state,",
        "                 colift_command *command) {",
        f"  (void)model;\n  {start.replace('f', 'g', 1)}\n}}\n",
        "int colift_step(const colift_model *model, colift_real t, const colift_measurement *m,",
        "                colift_state *state, colift_command *command) {",
        *(f"  {line}" for line in ["outside = 0;", *rooms, step, *moves, "return outside;"]),
        "}\n",
    ])  # fmt: skip


def _call(structs: dict[str, CStruct], made: TracedKernel, remembered: Sequence[str]) -> str:
    """The call of a kernel; `remembered`: where the next memory goes."""
    arguments = [
        structs[of].pointer("m" if of == "measurement" else of, k) if of in structs else f"&{of}"
        for of, k in made.arguments
    ]
    command = structs["command"]
    commanded = [command.pointer("command", k) for k in made.kernel.results if k < len(command.leaves)]
    return f"{made.kernel.name}({', '.join([*arguments, *commanded, *remembered])});"


CMAKE = """cmake_minimum_required(VERSION 3.16)
project(colift_onboard C)

set(CMAKE_C_STANDARD 99)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
option(COLIFT_FLOAT32 "single precision" OFF)
option(COLIFT_NATIVE "for the processor that compiles, with all its vectors" OFF)

add_library(colift colift.c learned.c)
target_include_directories(colift PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
target_link_libraries(colift PUBLIC m)
if(COLIFT_FLOAT32)
  target_compile_definitions(colift PUBLIC COLIFT_FLOAT32)
  target_compile_options(colift PRIVATE -fsingle-precision-constant)
endif()
if(COLIFT_NATIVE)
  target_compile_options(colift PRIVATE -march=native)
endif()
if(CMAKE_C_COMPILER_ID STREQUAL "GNU")
  target_compile_options(colift PRIVATE -Wno-psabi) # no vector leaves colift.c
endif()

add_executable(replay replay.c)
target_link_libraries(replay colift)
"""
