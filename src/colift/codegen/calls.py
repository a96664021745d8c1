"""Emission of blocks: C loops, branches, and reads and writes at computed indices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from colift.codegen.blocks import Block, Branch, Map, Read, Scan, While, Window, Write
from colift.codegen.layout import ArrayRef, FunctionLayout, c_literal
from colift.codegen.liveness import BlockLiveness, Liveness, writes_in_place

if TYPE_CHECKING:
    from colift.codegen.emit import FunctionEmitter

IDENTITY = {"add": "0.0", "mul": "1.0", "max": "-INFINITY", "min": "INFINITY"}


def emit(body: FunctionEmitter, block: int) -> None:
    """Add the statements of a block; a write in place is deferred to `emit_final_writes`.

    Args:
        body: Function that contains the block; the statements of the block's inputs are present.
        block: Index of the block.
    """
    b, call = body.g.blocks[block], body.liveness.calls[block]
    if block in body.final_writes:
        return
    carried = len(b.outputs) if isinstance(b, While) else b.carry if isinstance(b, Scan) else 0
    for k, (size, required) in enumerate(zip(b.outputs, call.required, strict=True)):
        if k >= carried and required.any() and (block, k) not in body.arrays:
            body.arrays[block, k] = body.array(size)
    match b:
        case Map():
            _map(body, b, call, _outputs(body, block))
        case Scan():
            _scan(body, block, b, call)
        case While():
            _while(body, block, b, call)
        case Branch():
            _branch(body, b, call, _outputs(body, block))
        case Read():
            _read(body, b, call, _outputs(body, block)[0])
        case Write():
            to = _outputs(body, block)[0]
            body.store_nodes(to, b.inputs[0], np.flatnonzero(call.used[0]))
            at, new = (body.pack(x, mask) for x, mask in zip(b.inputs[1:], call.used[1:], strict=True))
            _store(body, b, to, at, new, guard=False)


def emit_final_writes(body: FunctionEmitter) -> None:
    """Add the writes into inputs, after all reads of these inputs.

    Args:
        body: Function; all other statements are present.
    """
    ready = []
    for block, to in body.final_writes.items():
        b, call = body.g.blocks[block], body.liveness.calls[block]
        at, new = (body.pack(x, mask, is_exclusive=True) for x, mask in zip(b.inputs[1:], call.used[1:], strict=True))
        ready.append((b, to, at, new))
    for b, to, at, new in ready:
        assert isinstance(b, Write)
        _store(body, b, to, at, new, guard=body.layout.guard)


def _outputs(body: FunctionEmitter, block: int) -> dict[int, ArrayRef]:
    """Return the locations of the required outputs of a block."""
    return {k: ref for (which, k), ref in body.arrays.items() if which == block}


def _add_lines(body: FunctionEmitter, *lines: str) -> None:
    """Add lines as one statement, so that outlining does not separate them."""
    body.add_line("\n  ".join(lines))


# maps


def _map(body: FunctionEmitter, b: Map, call: BlockLiveness, outputs: dict[int, ArrayRef]) -> None:
    """Add a loop over rows; for a single sample the lanes of a vector hold rows."""
    (inner,) = call.functions
    lanes = body.lanes
    if lanes == 1 and body.unit.agent_lanes > 1 and not _longer_inside(inner, b):
        lanes = min(body.unit.agent_lanes, 1 << (b.length - 1).bit_length())
    across = lanes != body.lanes  # whether lanes hold rows
    uniform = frozenset(k for k, m in enumerate(b.mapped) if not m) if across else frozenset()
    function = body.unit.add(b.function, inner, FunctionLayout(lanes, uniform=uniform))
    first, before, args = _map_arguments(body, b, call, lanes if across else 0)
    after, end = [], []
    for k, required in enumerate(inner.required):
        if not required.any():
            continue
        to, name = outputs[k], body.new_name("t")
        if not b.reductions[k] and not across:
            args.append(f"{to} + i * {required.size}")
            continue
        first.append(f"V_{lanes} {name}[{required.size}];")
        args.append(name)
        if b.reductions[k]:
            start, inside, last = _reduction_lines(
                to, b.reductions[k], name, required.size, lanes, b.length if across else 0
            )
            first, after, end = [*first, *start], [*after, inside], [*end, *last]
        else:
            after += [
                f"for (long e = {low}; e < {high}; e++) for (int l = 0; l < WIDTH_{lanes} && i + l < {b.length}; l++) "
                f"({to})[(i + l) * {required.size} + e] = {_lane_expression(f'{name}[e]', lanes)};"
                for low, high in _intervals(required)
            ]
    loop = f"for (long i = 0; i < {b.length}; i += {f'WIDTH_{lanes}' if across else 1}) {{"
    _add_lines(body, "{", *first, loop, *before, f"{function}({', '.join(args)});", *after, "}", *end, "}")


def _map_arguments(
    body: FunctionEmitter, b: Map, call: BlockLiveness, lanes: int
) -> tuple[list[str], list[str], list[str]]:
    """Return the statements before and inside a loop that load the inputs of row i, and the arguments of the call.

    If `lanes` is positive, one iteration loads that many rows.
    """
    (inner,) = call.functions
    first, before, args = [], [], []
    for k, (nodes, mask) in enumerate(zip(b.inputs, call.used, strict=True)):
        if not mask.any():
            continue
        if not b.mapped[k]:
            args.append(str(body.pack(nodes, mask)))
            continue
        ref, elements, offsets, stride = _row_location(body, nodes.reshape(b.length, -1), inner.used[k])
        shift = int(offsets[0] - elements[0])
        if not lanes and (offsets - elements == shift).all() and shift >= 0:
            args.append(f"{ref + shift} + i * {stride}")
            continue
        name = body.new_name("t")
        first.append(f"V_{lanes or body.lanes} {name}[{b.function.inputs[k]}];")
        args.append(name)
        row = "i" if not lanes else f"(i + l < {b.length} ? i + l : {b.length - 1})" if b.length % lanes else "(i + l)"
        for e, n, offset, step in _strided_runs(elements, offsets):
            each = f"for (int l = 0; l < WIDTH_{lanes}; l++) " if lanes else ""
            one = _lane_expression(f"({name} + {e})[e]", lanes or 1)
            value = f"({ref + offset})[e * {step} + {row} * {stride}]"
            before.append(f"for (long e = 0; e < {n}; e++) {each}{one} = {value};")
    return first, before, args


def _reduction_lines(
    to: ArrayRef, reduction: str, row: str, size: int, lanes: int, length: int
) -> tuple[list[str], str, list[str]]:
    """Return the statements before, inside and after a loop that reduce the rows of one output.

    `length` is 0 if lanes do not hold rows. Otherwise each lane accumulates a partial result until the end.
    """
    each = f"for (long e = 0; e < {size}; e++)"
    if not length:
        start = f"{each} ({to})[e] = splat_{lanes}({IDENTITY[reduction]});"
        return [start], f"{each} ({to})[e] = {_combine(reduction, lanes, f'({to})[e]', f'{row}[e]')};", []
    total = f"sum_{row}"
    start = [f"V_{lanes} {total}[{size}];", f"{each} {total}[e] = splat_{lanes}({IDENTITY[reduction]});"]
    whole = _combine(reduction, lanes, f"{total}[e]", f"{row}[e]")
    inside = f"if (i + WIDTH_{lanes} <= {length}) {each} {total}[e] = {whole};"
    if length % lanes:
        lane_total = _lane_expression(f"{total}[e]", lanes)
        one = _combine(reduction, 1, lane_total, _lane_expression(f"{row}[e]", lanes))
        inside += f" else {each} for (int l = 0; i + l < {length}; l++) {lane_total} = {one};"
    one = _combine(reduction, 1, f"({to})[e]", _lane_expression(f"{total}[e]", lanes))
    first = _lane_expression(f"{total}[e]", lanes, "0")
    end = f"{each} {{ ({to})[e] = {first}; for (int l = 1; l < WIDTH_{lanes}; l++) ({to})[e] = {one}; }}"
    return start, inside, [end]


def _lane_expression(vector: str, lanes: int, lane: str = "l") -> str:
    """Return the C expression of one lane; without compiler support for vectors, a vector is one number."""
    return vector if lanes == 1 else f"AT_{lanes}({vector}, {lane})"


def _combine(reduction: str, lanes: int, a: str, b: str) -> str:
    """Return the C expression of a reduction operation."""
    sign = {"add": "+", "mul": "*"}.get(reduction)
    return f"{a} {sign} {b}" if sign else f"{reduction}_{lanes}({a}, {b})"


def _longer_inside(inner: Liveness, b: Map) -> bool:
    """Return whether the body contains a longer loop, which fills the lanes better."""

    def longest(function_blocks: Sequence[Block], live: Liveness) -> int:
        found = 0
        for k, call in live.calls.items():
            one = function_blocks[k]
            found = max(found, one.length if isinstance(one, Map) else 0)
            for f, nested in zip(one.functions, call.functions, strict=True):
                found = max(found, longest(f.graph.blocks, nested))
        return found

    return longest(b.function.graph.blocks, inner) > b.length


def _row_location(
    body: FunctionEmitter, nodes: np.ndarray, mask: np.ndarray
) -> tuple[ArrayRef, np.ndarray, np.ndarray, int]:
    """Locate the rows of an array: location, required elements, their offsets, and the distance between rows."""
    elements = np.flatnonzero(mask)
    rows = nodes[:, elements]
    body.require(rows.ravel())
    at = body.g.range_indices(rows)
    stride = int(rows[1, 0] - rows[0, 0]) if len(rows) > 1 else 0
    if at[0, 0] >= 0 and (at == at[0, 0]).all() and (np.diff(rows, axis=0) == stride).all() and stride >= 0:
        start, _, kind, array, block = body.g.ranges[int(at[0, 0])]
        ref = body.array_ref(kind, array, block)
        if not ref.uniform:
            return ref, elements, rows[0] - start, stride
    whole = body.pack(nodes.ravel(), np.tile(mask, len(nodes)))
    return whole, elements, elements, nodes.shape[1]


def _strided_runs(elements: np.ndarray, offsets: np.ndarray) -> Iterator[tuple[int, int, int, int]]:
    """Iterate over runs of adjacent elements with equally spaced offsets: first element, count, offset, step."""
    k = 0
    while k < len(elements):
        n, step = 1, 1
        if k + 1 < len(elements) and elements[k + 1] == elements[k] + 1:
            step = int(offsets[k + 1] - offsets[k])
            while (
                k + n < len(elements) and elements[k + n] == elements[k] + n and offsets[k + n] == offsets[k] + n * step
            ):
                n += 1
        yield int(elements[k]), n, int(offsets[k]), step
        k += n


def _intervals(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return the intervals in which a mask is true."""
    at = np.flatnonzero(mask)
    cuts = np.flatnonzero(np.diff(at) > 1)
    return [(int(at[i]), int(at[j]) + 1) for i, j in zip([0, *(cuts + 1)], [*cuts, at.size - 1], strict=True)]


# loops over time


class _Carry:
    """Storage of the carry of a loop.

    A carried array either stays unchanged, is written in place, or alternates between two buffers.
    """

    def __init__(
        self,
        body: FunctionEmitter,
        block: int,
        b: Scan | While,
        call: BlockLiveness,
        step: Liveness,
        before: int,
        count: int,
    ) -> None:
        function, consts = b.function, b.consts
        self.inputs: dict[int, str] = {}  # C expression of each argument of the step
        self.outputs: dict[int, str] = {}
        self.moved: list[tuple[str, str, ArrayRef, np.ndarray]] = []
        kept, written = set(), []
        for k in range(count):
            nodes, mask = b.inputs[before + k], call.used[before + k]
            if not mask.any():
                continue
            argument, out = consts + k, function.outputs[k]
            own = function.graph.element(int(out[np.flatnonzero(mask)[0]]))
            same = (
                own is not None
                and own[:2] == ("in", argument)
                and (np.diff((out - np.arange(out.size))[mask]) == 0).all()
            )
            if same and own is not None and own[3] == np.flatnonzero(mask)[0]:
                kept.add(k)
                ref = body.pack(nodes, mask)
            else:
                ref = body.pack(nodes, mask, is_exclusive=True)
                if writes_in_place(function, step, k, argument):
                    written.append((k, argument))
                else:
                    current, updated = body.new_name("c"), body.new_name("c")
                    self.moved.append((current, updated, ref, mask))
            body.arrays[block, k] = ref
            moves = self.moved and self.moved[-1][2] is ref
            name = self.moved[-1][0] if moves else str(ref)
            if step.used[argument].any() or (k, argument) in written:
                self.inputs[argument] = name
            if moves:
                self.outputs[k] = self.moved[-1][1]
        self.kept, self.written = frozenset(kept), tuple(written)
        w = body.lanes
        self.start = [
            f"V_{w} *{current} = {ref}, *{updated} = {body.array(mask.size)};"
            for current, updated, ref, mask in self.moved
        ]
        self.swap = [
            f"{{ V_{w} *const was = {current}; {current} = {updated}; {updated} = was; }}"
            for current, updated, *_ in self.moved
        ]
        self.end = [
            f"if ({current} != {ref}) memcpy({ref}, {current}, {mask.size} * sizeof(V_{w}));"
            for current, _, ref, mask in self.moved
        ]


def _scan(body: FunctionEmitter, block: int, b: Scan, call: BlockLiveness) -> None:
    """Add a loop with a fixed number of steps."""
    (step,) = call.functions
    carry = _Carry(body, block, b, call, step, b.consts, b.carry)
    shape = FunctionLayout(body.lanes, kept=carry.kept, written=carry.written)
    function = body.unit.add(b.function, step, shape)
    args = dict(carry.inputs)
    for k, (nodes, mask) in enumerate(zip(b.inputs, call.used, strict=True)):
        if not b.consts <= k < b.consts + b.carry and mask.any():
            steps = f" + t * {b.function.inputs[k]}" if k >= b.consts else ""
            args[k] = f"{body.pack(nodes, mask)}{steps}"
    outs = dict(carry.outputs)
    for k in range(b.carry, len(b.outputs)):
        if step.required[k].any():
            outs[k] = f"{body.arrays[block, k]} + t * {step.required[k].size}"
    count = f"long t = {b.length - 1}; t >= 0; t--" if b.reverse else f"long t = 0; t < {b.length}; t++"
    called = f"{function}({', '.join([*_sorted(args), *_sorted(outs)])});"
    _add_lines(body, "{", *carry.start, f"for ({count}) {{", called, *carry.swap, "}", *carry.end, "}")


def _sorted(args: dict[int, str]) -> list[str]:
    """Return expressions in order of their index."""
    return [args[k] for k in sorted(args)]


def _while(body: FunctionEmitter, block: int, b: While, call: BlockLiveness) -> None:
    """Add a loop that runs until the condition fails in every lane; finished lanes keep their carry."""
    requested, step = call.functions
    w, before = body.lanes, b.tests + b.consts
    carry = _Carry(body, block, b, call, step, before, len(b.outputs))
    guard = w > 1 and bool(carry.written)
    test = body.unit.add(b.test, requested, FunctionLayout(w))
    function = body.unit.add(b.function, step, FunctionLayout(w, kept=carry.kept, written=carry.written, guard=guard))

    def constants(first: int, used: Sequence[np.ndarray], count: int) -> dict[int, str]:
        return {k: str(body.pack(b.inputs[first + k], used[k])) for k in range(count) if used[k].any()}

    tested = constants(0, requested.used, b.tests)
    names = {k: carry.inputs.get(b.consts + k) for k in range(len(b.outputs))}
    for k, used in enumerate(requested.used[b.tests :]):
        if used.any():
            moved = next((current for current, _, ref, _ in carry.moved if ref is body.arrays[block, k]), None)
            tested[b.tests + k] = moved or names[k] or str(body.arrays[block, k])
    args = {**constants(b.tests, step.used, b.consts), **carry.inputs}
    flag = body.array(1)
    go = ["go"] if guard else []
    called = f"{function}({', '.join([*_sorted(args), *_sorted(carry.outputs), *[f'&{g}_on' for g in go]])});"
    lines = [f"{test}({', '.join([*_sorted(tested), str(flag)])});"]
    if w == 1:
        lines.append(f"if ({flag[0]} == 0) break;")
    else:
        lines += [f"const M_{w} go_on = ne_{w}({flag[0]}, splat_{w}(0.0));", f"if (!any_{w}(go_on)) break;"]
    lines.append(called)
    if w > 1:
        lines += [
            f"for (long e = {low}; e < {high}; e++) {updated}[e] = sel_{w}(go_on, {updated}[e], {current}[e]);"
            for current, updated, _, mask in carry.moved
            for low, high in _intervals(mask)
        ]
    _add_lines(body, "{", *carry.start, "for (;;) {", *lines, *carry.swap, "}", *carry.end, "}")


# branches


def _branch(body: FunctionEmitter, b: Branch, call: BlockLiveness, outputs: dict[int, ArrayRef]) -> None:
    """Add a branch; with several lanes, each case runs if any lane requires it, and the results are blended."""
    w, last = body.lanes, len(b.branches) - 1
    index = body.value(int(b.inputs[0][0]))
    packs = [body.pack(x, m) if m.any() else None for x, m in zip(b.inputs[1:], call.used[1:], strict=True)]
    made = {k: body.array(size) if w > 1 else outputs[k] for k, size in _sizes(b, outputs)}
    lines = [f"const V_{w} which = {index};"]
    if w > 1:
        lines.append(f"M_{w} left = eq_{w}(splat_{w}(0.0), splat_{w}(0.0));")
    for k, (f, live) in enumerate(zip(b.branches, call.functions, strict=True)):
        function = body.unit.add(f, live, FunctionLayout(w))
        args = [str(p) for p, used in zip(packs, live.used, strict=True) if p is not None and used.any()]
        args += [str(made[i]) for i in sorted(made)]
        called = f"{function}({', '.join(args)});"
        if w == 1:
            condition = "" if k == last else f"if (which <= {k}.0) "
            lines.append(f"{'else ' if k else ''}{condition}{{ {called} }}")
            continue
        mine = "left" if k == last else f"left & le_{w}(which, splat_{w}({k}.0))"
        blend = [
            f"for (long e = {low}; e < {high}; e++) ({to})[e] = sel_{w}(mine, ({made[i]})[e], ({to})[e]);"
            for i, to in outputs.items()
            for low, high in _intervals(call.required[i])
        ]
        lines.append(
            f"{{ const M_{w} mine = {mine}; if (any_{w}(mine)) {{ {called} {' '.join(blend)} }} left &= ~mine; }}"
        )
    _add_lines(body, "{", *lines, "}")


def _sizes(b: Branch, outputs: dict[int, ArrayRef]) -> list[tuple[int, int]]:
    """Return index and size of each required output."""
    return [(k, b.outputs[k]) for k in outputs]


# reads and writes


def _window_lines(window: Window, w: int, at: ArrayRef) -> tuple[list[str], str]:
    """Return the statements that set `at` to the start of window q and `in` to whether it fits.

    The second result is the C expression of the offset of element e.
    """
    kinds = len(window.stride)
    table = len(window.base) > 1
    lines = ["long at = base[q]; int in = 1;" if table else f"long at = {int(window.base[0])}; int in = 1;"]
    for d, (stride, last) in enumerate(zip(window.stride, window.max_index, strict=True)):
        index = _lane_expression(f"({at})[q * {kinds} + {d}]", w)
        lines.append(
            f"{{ const real k = {index}; in &= k >= 0 && k <= {last}; "
            f"at += {stride} * (long)(k > 0 ? (k < {last} ? k : {last}) : 0); }}"
        )
    if not window.drops:
        lines.append("in = 1;")
    plain = (window.offset == np.arange(window.offset.size)).all()
    return lines, "e" if plain else "offset[e]"


def _window_tables(window: Window) -> list[str]:
    """Return the declarations of the tables that `_window_lines` uses."""
    tables = []
    if len(window.base) > 1:
        tables.append(f"static const int base[] = {{{', '.join(map(str, window.base.tolist()))}}};")
    if not (window.offset == np.arange(window.offset.size)).all():
        tables.append(f"static const int offset[] = {{{', '.join(map(str, window.offset.tolist()))}}};")
    return tables


def _window_loop(window: Window, w: int) -> str:
    """Return the head of the loop over windows and lanes."""
    lanes = f" for (int l = 0; l < WIDTH_{w}; l++)" if w > 1 else ""
    return f"for (long q = 0; q < {len(window.base)}; q++){lanes} {{"


def _read(body: FunctionEmitter, b: Read, call: BlockLiveness, to: ArrayRef) -> None:
    window, w, n = b.window, body.lanes, b.window.offset.size
    source, at = (body.pack(x, mask) for x, mask in zip(b.inputs, call.used, strict=True))
    location_lines, element = _window_lines(window, w, at)
    one = _lane_expression(f"({source})[at + {element}]", w)
    if window.drops:
        one = f"in ? {one} : {c_literal(b.fill_value)}"
    copy = f"for (long e = 0; e < {n}; e++) {_lane_expression(f'({to})[q * {n} + e]', w)} = {one};"
    _add_lines(body, "{", *_window_tables(window), _window_loop(window, w), *location_lines, copy, "}", "}")


def _store(body: FunctionEmitter, b: Write, to: ArrayRef, at: ArrayRef, new: ArrayRef, *, guard: bool) -> None:
    window, w, n = b.window, body.lanes, b.window.offset.size
    location_lines, element = _window_lines(window, w, at)
    target, new_value = _lane_expression(f"({to})[at + {element}]", w), _lane_expression(f"({new})[q * {n} + e]", w)
    value = _combine(b.reduction, 1, target, new_value) if b.reduction else new_value
    value = f"{b.check}_1({value})" if b.check else value
    skip = [f"if (!{_lane_expression('(*go)', w)}) continue;"] if guard else []
    copy = f"if (in) for (long e = 0; e < {n}; e++) {target} = {value};"
    _add_lines(body, "{", *_window_tables(window), _window_loop(window, w), *skip, *location_lines, copy, "}", "}")
