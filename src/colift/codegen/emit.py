"""Emission of C from graphs: required nodes only, in depth-first order, for a number of vector lanes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from colift.codegen import calls, outlining
from colift.codegen.blocks import Function, Nodes, Scan, While
from colift.codegen.graph import COMPARE
from colift.codegen.layout import ArrayRef, FunctionLayout, c_literal, copy_runs
from colift.codegen.liveness import Liveness

BINARY = {"add": "+", "sub": "-", "mul": "*", "div": "/", "and": "&", "or": "|"}
STACK_BYTES = 1 << 18  # arrays of one function on the stack; larger frames are allocated


class TranslationUnit:
    """C translation unit under construction; functions with equal text are emitted once.

    Attributes:
        agent_lanes: Agents or rows per vector inside loops of a single sample.
        stack_bytes: Maximum size of the frame of one function on the stack.
        widths: Vector widths that the functions use.
        names: Name of each function, by its text.
    """

    def __init__(self, agent_lanes: int = 1, stack_bytes: int = STACK_BYTES) -> None:
        """Make an empty unit."""
        self.agent_lanes = agent_lanes
        self.stack_bytes = stack_bytes
        self.widths: set[int] = {1}
        self.names: dict[str, str] = {}

    def add(self, function: Function, live: Liveness, layout: FunctionLayout) -> str:
        """Emit a function unless its text exists.

        Args:
            function: Function.
            live: Required parts.
            layout: Calling convention.

        Returns:
            Name of the C function.
        """
        self.widths.add(layout.lanes)
        text = FunctionEmitter(self, function, live, layout).text()
        return self.names.setdefault(text, f"f{len(self.names)}")

    def functions(self) -> str:
        """Return the text of all functions, callees first."""
        return outlining.split_into_pieces([text.replace("@name", name) for text, name in self.names.items()])


class FunctionEmitter:
    """Emission of one function: statements in the order of a depth-first search from the outputs.

    Attributes:
        names: C expression of each emitted node.
        lines: Statements.
        frame_size: Elements of the frame `m`, the local array that stores all other arrays.
        packs: Location of node arrays that were copied to the frame.
        arrays: Location of each output of a block, by block and output.
        done: Blocks that are emitted.
        final_writes: Blocks that write into an input, and the location of that input.
    """

    def __init__(self, unit: TranslationUnit, function: Function, live: Liveness, layout: FunctionLayout) -> None:
        """Prepare the emission of a function."""
        self.unit, self.function, self.g, self.liveness, self.layout = unit, function, function.graph, live, layout
        self.lanes = layout.lanes
        self.names: dict[int, str] = {}
        self.lines: list[outlining.Line] = []
        self.frame_size = 0
        self.packs: dict[tuple, ArrayRef] = {}
        self.arrays: dict[tuple[int, int], ArrayRef] = {}
        self.done: set[int] = set()
        self.final_writes: dict[int, ArrayRef] = {}
        self.counter = 0

    def text(self) -> str:
        """Return the C text; the name of the function is the placeholder `@name`."""
        outputs, live, layout = self.function.outputs, self.liveness, self.layout
        stored = [
            k for k in range(len(outputs)) if live.required[k].any() and k not in {*layout.kept, *dict(layout.written)}
        ]
        for k, j in layout.written:
            self.final_writes[self._block_of(outputs[k])] = ArrayRef(f"a{j}")
        direct = self._direct_outputs(stored)
        for k in stored:
            if k in direct:
                self.require(outputs[k][:1])
            else:
                self.store_nodes(ArrayRef(f"o{k}"), outputs[k], np.flatnonzero(live.required[k]))
        calls.emit_final_writes(self)
        w, written = self.lanes, {j for _, j in layout.written}
        parameters = {
            f"a{k}": f"{'' if k in written else 'const '}V_{1 if k in layout.uniform else w} *restrict a{k}"
            for k, used in enumerate(live.used)
            if used.any() or k in written
        }
        parameters |= {f"o{k}": f"V_{w} *restrict o{k}" for k in stored}
        if layout.guard:
            parameters["go"] = f"const M_{w} *restrict go"
        return outlining.assemble(self.lines, parameters, w, self.frame_size, self.unit.stack_bytes)

    def _block_of(self, nodes: Nodes) -> int:
        """Return the block that computes the given nodes."""
        element = self.g.element(int(nodes[0]))
        assert element is not None
        return element[2]

    def _direct_outputs(self, indices: Sequence[int]) -> set[int]:
        """Find the outputs that equal one array of a block; the block stores them directly."""
        direct = set()
        for k in indices:
            out = self.function.outputs[k]
            element = self.g.element(int(out[0]))
            if element is None or element[0] != "out" or element[3] != 0:
                continue
            _, array, block, _ = element
            b = self.g.blocks[block]
            carried = isinstance(b, While) or (isinstance(b, Scan) and array < b.carry)
            whole = b.outputs[array] == out.size and (np.diff(out) == 1).all()
            if whole and not carried and (block, array) not in self.arrays and block not in self.final_writes:
                self.arrays[block, array] = ArrayRef(f"o{k}")
                direct.add(k)
        return direct

    # values

    def value(self, node: int) -> str:
        """Emit a node and return its C expression."""
        self.require(np.array([node]))
        return self.expression(node)

    def expression(self, node: int) -> str:
        """Return the C expression of a node that is emitted."""
        if node in self.names:
            return self.names[node]
        element = self.g.element(node)
        assert element is not None
        kind, array, block, index = element
        ref = self.array_ref(kind, array, block)
        return f"splat_{self.lanes}({ref[index]})" if ref.uniform else ref[index]

    def array_ref(self, kind: str, array: int, block: int) -> ArrayRef:
        """Return the location of an input (`kind` "in") or of an output of a block."""
        uniform = self.lanes > 1 and array in self.layout.uniform
        return ArrayRef(f"a{array}", 0, uniform) if kind == "in" else self.arrays[block, array]

    def require(self, nodes: Nodes) -> None:
        """Emit nodes and their dependences; the stack holds nodes, and blocks as `~block`."""
        stack = self._missing(nodes)
        while stack:
            top = stack[-1]
            block, is_block = ~top, top < 0
            if (block in self.done) if is_block else (top in self.names):
                stack.pop()
                continue
            before = self._arguments(block) if is_block else self._missing_of(top)
            if before:
                stack += reversed(before)
                continue
            stack.pop()
            if is_block:
                self.done.add(block)
                calls.emit(self, block)
            else:
                self._emit(top)

    def _missing_of(self, node: int) -> list[int]:
        """Return the arguments of an expression that are not emitted."""
        missing = []
        for n in self.g.arguments(node):
            if n in self.names:
                continue
            element = self.g.element(n)
            if element is None:
                missing.append(n)
            elif element[0] == "out" and element[2] not in self.done:
                missing.append(~element[2])
        return missing

    def _missing(self, nodes: Nodes) -> list[int]:
        """Return the nodes and blocks that are not emitted."""
        at = self.g.range_indices(nodes)
        missing = [n for n in nodes[at < 0].tolist() if n not in self.names]
        blocks = {self.g.ranges[k][4] for k in set(at[at >= 0].tolist())}
        return missing + [~b for b in sorted(blocks) if b >= 0 and b not in self.done]

    def _arguments(self, block: int) -> list[int]:
        """Return the inputs of a block that are not emitted."""
        b, call = self.g.blocks[block], self.liveness.calls[block]
        return [n for arg, mask in zip(b.inputs, call.used, strict=True) for n in self._missing(arg[mask])]

    def _emit(self, node: int) -> None:
        """Add the statement of an expression whose arguments are emitted."""
        op, *args = self.g.code[node]
        w = self.lanes
        if op == "const":
            self.names[node] = c_literal(args[0]) if w == 1 else f"splat_{w}({c_literal(args[0])})"
            return
        x = [self.expression(a) for a in args]
        if op in ("true", "false"):
            zero = f"splat_{w}(0.0)"
            self.names[node] = f"{'eq' if op == 'true' else 'ne'}_{w}({zero}, {zero})"
            return
        if op in ("sin", "cos"):
            self._sincos(args[0], x[0])
            return
        if op in BINARY:
            code = f"{x[0]} {BINARY[op]} {x[1]}"
        elif op == "neg":
            code = f"-{x[0]}"
        elif op == "not":
            code = f"~{x[0]}"
        elif op in COMPARE:
            code = f"{op}_{w}({x[0]}, {x[1]})"
        elif op in ("nonzero", "flag"):
            code = f"ne_{w}({x[0]}, splat_{w}(0.0))"
        elif op == "select":
            code = f"sel_{w}({x[0]}, {x[1]}, {x[2]})"
        else:
            code = f"{op}_{w}({', '.join(x)})"
        name, mask = self.new_name("x"), self.g.is_mask(node)
        self.add_line(f"const {'M' if mask else 'V'}_{w} {name} = {code};", {name: mask})
        self.names[node] = name

    def _sincos(self, argument: int, x: str) -> None:
        """Add one statement that computes sine and cosine of an argument."""
        s, c = self.new_name("x"), self.new_name("x")
        self.add_line(f"V_{self.lanes} {s}, {c}; sincos_{self.lanes}({x}, &{s}, &{c});", {s: False, c: False})
        self.names[self.g.make("sin", argument)] = s
        self.names[self.g.make("cos", argument)] = c

    def new_name(self, prefix: str) -> str:
        """Return an unused C name that begins with a letter."""
        self.counter += 1
        return f"{prefix}{self.counter}"

    def add_line(self, text: str, defines: dict[str, bool] | None = None) -> None:
        """Add a statement; `defines` lists the names that it defines, and whether each is a mask."""
        self.lines.append(outlining.Line(text, defines or {}))

    # arrays

    def array(self, size: int) -> ArrayRef:
        """Reserve an array in the frame."""
        self.frame_size += size
        return ArrayRef("m", self.frame_size - size)

    def pack(self, nodes: Nodes, mask: np.ndarray, *, is_exclusive: bool = False) -> ArrayRef:
        """Return a location where nodes are contiguous; copy them to the frame if necessary.

        Args:
            nodes: Nodes of the array.
            mask: Elements that are required; the others may hold any value.
            is_exclusive: Whether the location must not be shared with other arrays.

        Returns:
            The location.
        """
        at = np.flatnonzero(mask)
        self.require(nodes[at])
        if not is_exclusive and (found := self._existing_array(nodes, at)) is not None:
            return found
        key = (nodes.tobytes(), mask.tobytes())
        if is_exclusive or key not in self.packs:
            ref = self.array(len(nodes))
            self.store_nodes(ref, nodes, at)
            if is_exclusive:
                return ref
            self.packs[key] = ref
        return self.packs[key]

    def _existing_array(self, nodes: Nodes, at: np.ndarray) -> ArrayRef | None:
        """Return the location of nodes that are contiguous in an existing array, or None."""
        ranges = self.g.range_indices(nodes[[at[0], at[-1]]])
        if ranges[0] < 0 or ranges[0] != ranges[1] or not (nodes[at] - at == nodes[at[0]] - at[0]).all():
            return None
        start, _, kind, array, block = self.g.ranges[int(ranges[0])]
        ref, shift = self.array_ref(kind, array, block), int(nodes[at[0]] - at[0]) - start
        return None if ref.uniform or shift < 0 else ref + shift

    def store_nodes(self, target: ArrayRef, nodes: Nodes, at: np.ndarray) -> None:
        """Store nodes in an array; rows of other arrays, repeated nodes and constants are copied by loops.

        Args:
            target: Location of the array.
            nodes: Nodes of the array.
            at: Indices of the elements to be stored.
        """
        self.require(nodes[at])
        w = self.lanes
        for kind, first, n, step in copy_runs(
            self.g.range_indices(nodes[at]), nodes[at], at, self.g.constant_mask(nodes[at])
        ):
            k, value = int(at[first]), self.expression(int(nodes[at[first]]))
            if kind == "row" and n > 3:
                start, _, of, array, block = self.g.ranges[int(self.g.range_indices(nodes[at[first : first + 1]])[0])]
                source = self.array_ref(of, array, block) + (int(nodes[k]) - start)
                if step == 1 and not source.uniform:
                    self.add_line(f"memcpy({target + k}, {source}, {n} * sizeof(V_{w}));")
                else:
                    value = f"({source})[e * {step}]"
                    value = f"splat_{w}({value})" if source.uniform else value
                    self.add_line(f"for (long e = 0; e < {n}; e++) ({target + k})[e] = {value};")
            elif kind == "same" and n > 3:
                self.add_line(f"for (long e = 0; e < {n}; e++) ({target + k})[e] = {value};")
            elif kind == "known" and n > 3:
                numbers = self.g.constant_values(nodes[at[first : first + n]])
                assert numbers is not None
                table = ", ".join(map(c_literal, numbers.tolist()))
                each = "t[e]" if w == 1 else f"splat_{w}(t[e])"
                self.add_line(f"{{ static const real t[] = {{{table}}}; "
                         f"for (long e = 0; e < {n}; e++) ({target + k})[e] = {each}; }}")  # fmt: skip
            else:
                for i in range(first, first + n):
                    self.add_line(f"{target[int(at[i])]} = {self.expression(int(nodes[at[i]]))};")
