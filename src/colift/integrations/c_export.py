"""C code generation for the onboard controller.

The generated C99 code computes one control period. It allocates no memory, starts no threads and requires the math
library only. The source is the same JAX code that simulations use. The residual model is a separate block of constants
behind a pointer, so that an assignment updates the model on board. A replay program compares the commands of the C code
with those of a simulated flight. The code was not tested on hardware.
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

STACK = 1 << 40  # bytes; so large that no array is allocated on the heap
LANES = 4  # agents or samples per vector; compilers map a vector to registers of two or four doubles
UNITS = {  # of the fields of measurements and commands; an attitude has no unit
    "R": "",
    "p": "m",
    "x": "m",
    "v": "m/s",
    "omega": "rad/s, body frame",
    "a": "m/s^2, specific force, body frame",
    "r": "rad or m",
    "lam": "N, frame of the tip",
    "moment": "N m, frame of the tip",
    "u": "N",
    "tau": "N m, body frame",
    "tau_r": "N m or N",
}


class ReplayData(NamedTuple):
    """Measurements and commands of a simulated flight; the first axis is time.

    Attributes:
        t: Times of the ticks [s].
        measurement: Measurements at the ticks.
        command: Commands that the controller computes from the measurements.
    """

    t: Array
    measurement: Measurement
    command: TeamInputs


def replay(
    experiment: flight.Experiment, model: residual_model.ResidualModel, ticks: int
) -> tuple[Measurement, ReplayData]:
    """Simulate a flight with a fixed residual model.

    Args:
        experiment: Experiment that defines world, controller and initial state.
        model: Residual model of the controller.
        ticks: Number of control periods.

    Returns:
        The measurement at rest before the flight, and measurements and commands of all ticks.
    """
    setup = dataclasses.replace(
        experiment.loop_config, controller=dataclasses.replace(experiment.controller, residual_model=model)
    )
    noise = experiment.world.sample_noise(jax.random.key(experiment.seed), ticks)
    flight_data = jax.jit(codegen.compile(_simulate))(setup, simulator.reset(setup, experiment.initial_state), noise)
    return experiment.world.measure_at_rest(experiment.initial_state), flight_data


def _simulate(setup: simulator.LoopConfig, loop: simulator.LoopState, noise: Any) -> ReplayData:
    """Simulate the closed loop and record measurements and commands."""

    def tick(state: tuple[Any, Any], context: tuple[Array, Any]) -> tuple[tuple[Any, Any], ReplayData]:
        (world, controller_state), (t, sample) = state, context
        clock = ControlClock(t=t, dt=setup.dt)
        m, world = setup.world.measure(world, clock, sample)
        command, controller_state, _ = setup.controller.step(controller_state, m, clock)
        world, _ = setup.world.step(world, command, clock)
        return (world, controller_state), ReplayData(t=t, measurement=m, command=command)

    ticks = jax.tree.leaves(noise)[0].shape[0]
    t = jnp.arange(ticks, dtype=float) * setup.dt
    return jax.lax.scan(tick, (loop.world, loop.controller), (t, noise))[1]


def export_c(
    experiment: flight.Experiment, model: residual_model.ResidualModel, ticks: int, folder: Path, name: str
) -> None:
    """Write the C code of a controller with its residual model, a flight for the replay program, and a CMake file.

    A folder that cannot be written raises `OSError`. A part of the controller that uses an operation without C code
    raises `codegen.UnsupportedPrimitive`, which names the source line.

    Args:
        experiment: Experiment that defines the controller and the flight.
        model: Residual model.
        ticks: Length of the flight in control periods.
        folder: Folder of the files; it is created if necessary.
        name: Name of the controller in the comments of the code.

    Example:
        >>> experiment = colift.make_experiment(colift.load("paper"), "C3")  # doctest: +SKIP
        >>> flight = colift.run(experiment)  # doctest: +SKIP
        >>> export_c(experiment, flight.model, 500, Path("c"), "paper, C3")  # doctest: +SKIP
    """
    experiment = experiment.calibrated()
    controller, dt = experiment.controller, jnp.asarray(experiment.dt)
    rest, flight_data = replay(experiment, model, ticks)

    def init_controller(model: residual_model.ResidualModel, first: Measurement) -> tuple[TeamInputs, Any]:
        return dataclasses.replace(controller, residual_model=model).init(first, ControlClock(t=jnp.zeros(()), dt=dt))

    def step_controller(
        model: residual_model.ResidualModel, t: Array, measurement: Measurement, state: Any
    ) -> tuple[TeamInputs, Any]:
        return dataclasses.replace(controller, residual_model=model).step(state, measurement, ControlClock(t=t, dt=dt))[
            :2
        ]

    command, state = jax.eval_shape(init_controller, model, rest)
    num_commands, num_inputs, num_states = (len(jax.tree.leaves(x)) for x in (command, (model, 0.0, rest), state))
    in_place = [(num_commands + k, num_inputs + k) for k in range(num_states)]
    init = _trace(init_controller, (), model=model, measurement=rest)
    tick = _trace(step_controller, in_place, model=model, t=jnp.zeros(()), measurement=rest, state=state)
    structs = {
        "model": CStruct(model, "residual model"),
        "measurement": CStruct(rest, "measurements at one time"),
        "state": CStruct(state, "internal state of the controller"),
        "command": CStruct({"agents": command}, "commands of the vehicles until the next call"),
    }
    for struct, k in (*init.arguments, *tick.arguments):
        if struct in structs:
            structs[struct].used.add(k)
    for struct in ("state", "command"):
        structs[struct].used |= {k for k, (_, shape) in enumerate(structs[struct].members) if 0 not in shape}
    header = _header(name, structs, experiment.dt)
    notice = f"/* {name}, generated by colift {version('colift')}. This file belongs to its user. */\n"
    initial_model = structs["model"].initializer(model)
    files = {
        "colift.h": notice + header,
        "colift.c": notice + _code(structs, init, tick),
        "learned.c": f'{notice}#include "colift.h"\n\nconst colift_model colift_trained_model = {initial_model};\n',
        "replay.c": notice + resources.files("colift.codegen").joinpath("replay.c").read_text(),
        "CMakeLists.txt": CMAKE,
    }
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in files.items():
        atomic_write.write_atomic(folder / file, text.encode())
    rows = np.concatenate(
        [
            np.asarray(flight_data.t)[:, None],
            structs["measurement"].rows(flight_data.measurement, ticks),
            structs["command"].rows(flight_data.command, ticks),
        ],
        axis=1,
    )
    first = np.concatenate([[0.0], structs["measurement"].rows(jax.tree.map(lambda x: x[None], rest), 1)[0]])
    first = np.pad(first, (0, rows.shape[1] - len(first)))
    atomic_write.write_atomic(folder / "flight.bin", np.concatenate([first[None], rows]).astype("<f8").tobytes())


class TracedKernel(NamedTuple):
    """C code of a function.

    Attributes:
        kernel: The C code.
        arguments: Struct name and member index of each parameter of the C function.
    """

    kernel: codegen.Kernel
    arguments: list[tuple[str, int]]


def _trace(f: Callable[..., Any], onto: Sequence[tuple[int, int]], **args: Any) -> TracedKernel:
    """Generate the C code of a function; `onto` contains pairs of a result and the argument that it overwrites."""
    kernel = codegen.kernel(
        jax.make_jaxpr(f)(*args.values()), agent_lanes=LANES, stack_bytes=STACK, in_place_results=onto
    )
    leaves = [(struct, k) for struct, tree in args.items() for k in range(len(jax.tree.leaves(tree)))]
    return TracedKernel(kernel=kernel, arguments=[leaves[k] for k in kernel.arguments])


class CStruct:
    """C struct that represents a PyTree: one member per leaf, named by its path; all numbers are `colift_real`.

    Attributes:
        description: Comment above the declaration.
        members: Name and shape of each member.
        used: Indices of the members that the code uses; the declaration contains only these.
    """

    def __init__(self, tree: Any, description: str) -> None:
        """Derive the members from a PyTree.

        Args:
            tree: PyTree of arrays.
            description: Comment above the declaration.
        """
        self.description = description
        self.members = [(_name(path), leaf.shape) for path, leaf in jax.tree_util.tree_leaves_with_path(tree)]
        self.used: set[int] = set()

    def declaration(self, name: str) -> str:
        """Return the declaration of the struct.

        Args:
            name: Name of the type without the prefix `colift_`.

        Returns:
            C code.
        """
        lines = []
        for k in sorted(self.used):
            member, shape = self.members[k]
            unit = UNITS.get(re.split(r"_\d+_|payload_", member)[-1], "")
            comment = ", ".join([unit] * bool(unit) + [" x ".join(map(str, shape))] * (len(shape) > 1))
            size = f"[{self.size(k)}]" if shape else ""
            lines.append(f"  colift_real {member}{size};" + (f" /* {comment} */" if comment else ""))
        return f"/* {self.description} */\ntypedef struct {{\n" + "\n".join(lines) + f"\n}} colift_{name};\n"

    def size(self, k: int) -> int:
        """Return the number of elements of the k-th member."""
        return int(np.prod(self.members[k][1]))

    def pointer(self, struct: str, k: int) -> str:
        """Return a C expression that points to the first number of a member.

        Args:
            struct: Name of a variable that points to the struct.
            k: Index of the member.

        Returns:
            C expression.
        """
        member, shape = self.members[k]
        return f"{struct}->{member}" if shape else f"&{struct}->{member}"

    def initializer(self, tree: Any) -> str:
        """Return a C initializer of the struct.

        Args:
            tree: PyTree with the values.

        Returns:
            C code.
        """
        values = jax.tree.leaves(tree)
        parts = []
        for k in sorted(self.used):
            numbers = ", ".join(repr(float(x)) for x in np.asarray(values[k], float).ravel())
            parts.append(f"  .{self.members[k][0]} = " + (f"{{{numbers}}}" if self.members[k][1] else numbers))
        return "{\n" + ",\n".join(parts) + "\n}"

    def rows(self, tree: Any, time: int) -> np.ndarray:
        """Return the numbers of all used members in their order.

        Args:
            tree: PyTree whose leaves have time as first axis.
            time: Number of times.

        Returns:
            One row per time.
        """
        values = jax.tree.leaves(tree)
        return np.concatenate([np.asarray(values[k], float).reshape(time, -1) for k in sorted(self.used)], axis=1)


def _name(path: Sequence[Any]) -> str:
    """Return the path of a leaf as a C identifier."""
    return re.sub(r"\W+", "_", jax.tree_util.keystr(tuple(path))).strip("_") or "value"


def _header(name: str, structs: dict[str, CStruct], dt: float) -> str:
    """Return the content of `colift.h`."""
    declarations = "\n".join(struct.declaration(struct_name) for struct_name, struct in structs.items())
    return f"""/*
 * Controller of {name}. Generated by colift from the code of its simulation; not tested on hardware.
 * SI units, z up; matrices by rows, agents in the order of the team. Call colift_step every {dt:g} s
 * with the time since the first call. No function allocates memory, keeps a static state or calls
 * functions outside the math library.
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

{declarations}
#define COLIFT_PERIOD {dt!r} /* s */

extern const colift_model colift_trained_model; /* residual model of the exported flight */

/* Computes the initial state and the command that holds the team at rest, from a measurement at rest. */
void colift_init(const colift_model *model, const colift_measurement *m, colift_state *state,
                 colift_command *command);

/* Computes the command of one control period. Returns 0, or 1 if a counter exceeds the exact integers. */
int colift_step(const colift_model *model, colift_real t, const colift_measurement *m, colift_state *state,
                colift_command *command);

#ifdef __cplusplus
}}
#endif
#endif
"""


def _code(structs: dict[str, CStruct], init: TracedKernel, tick: TracedKernel) -> str:
    """Return the content of `colift.c`."""
    read = lambda name: resources.files("colift.codegen").joinpath(name).read_text()  # noqa: E731
    num_commands, state = len(structs["command"].members), structs["state"]
    initial = [state.pointer("state", k - num_commands) for k in init.kernel.results if k >= num_commands]
    copied = [k - num_commands for k in tick.kernel.results if k >= num_commands]  # the others are updated in place
    buffers = {k: f"next_{state.members[k][0]}" for k in copied}
    declarations = [f"colift_real {buffer}[{state.size(k)}];" for k, buffer in buffers.items()]
    copies = [f"memcpy({state.pointer('state', k)}, {buffer}, sizeof {buffer});" for k, buffer in buffers.items()]
    start, step = _call(structs, init, initial), _call(structs, tick, list(buffers.values()))
    return "\n".join([
        '#include "colift.h"\n',
        read("onboard.h"),
        codegen.lanes_header(sorted({*init.kernel.widths, *tick.kernel.widths})),
        re.sub(r"\bf(\d)", r"g\1", init.kernel.text),  # distinct names of the functions of the two kernels
        "#undef PIECES\n#undef WHOLE",
        tick.kernel.text,
        "void colift_init(const colift_model *model, const colift_measurement *m, colift_state *state,",
        "                 colift_command *command) {",
        f"  (void)model;\n  {start.replace('f', 'g', 1)}\n}}\n",
        "int colift_step(const colift_model *model, colift_real t, const colift_measurement *m,",
        "                colift_state *state, colift_command *command) {",
        *(f"  {line}" for line in ["integer_overflow = 0;", *declarations, step, *copies, "return integer_overflow;"]),
        "}\n",
    ])  # fmt: skip


def _call(structs: dict[str, CStruct], traced: TracedKernel, next_state: Sequence[str]) -> str:
    """Return the call of a kernel; `next_state` contains the destinations of the next state."""
    arguments = [
        structs[struct].pointer("m" if struct == "measurement" else struct, k) if struct in structs else f"&{struct}"
        for struct, k in traced.arguments
    ]
    command = structs["command"]
    commands = [command.pointer("command", k) for k in traced.kernel.results if k < len(command.members)]
    return f"{traced.kernel.name}({', '.join([*arguments, *commands, *next_state])});"


CMAKE = """cmake_minimum_required(VERSION 3.16)
project(colift_onboard C)

set(CMAKE_C_STANDARD 99)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
option(COLIFT_FLOAT32 "single precision" OFF)
option(COLIFT_NATIVE "instruction set of the compiling processor" OFF)

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
  target_compile_options(colift PRIVATE -Wno-psabi) # no vector type crosses the interface of colift.c
endif()

add_executable(replay replay.c)
target_link_libraries(replay colift)
"""
