"""Numbers that remember how they were computed: products and sums on a list, constants folded.

A :class:`Symbol` is plus or minus a node of a :class:`Trace`, which fuses products into the sums that use them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from pinotwin.arrays import Floats, Ints

Node: TypeAlias = tuple[str, int, int, float]
"""kind, first and second node (or number of the input), and sign of the second or the constant."""


class Trace:
    """The list of nodes under construction."""

    def __init__(self, inputs: int) -> None:
        self.inputs = inputs
        self.nodes: list[Node] = []
        self._known: dict[Node, int] = {}

    def input(self, k: int) -> Symbol:
        """Return the k-th input."""
        return Symbol(self, self._node(("in", k, 0, 0.0)), 1.0)

    def constant(self, value: float) -> int:
        """Return the node of a positive constant."""
        return self._node(("const", 0, 0, float(value)))

    def product(self, i: int, j: int) -> tuple[int, float]:
        """Return node and sign of a product; two constant factors become one."""
        a, b = sorted((i, j), key=lambda k: self.nodes[k][0] != "const")
        kind, first, second, _ = self.nodes[b]
        if self.nodes[a][0] == "const" and kind == "mul" and self.nodes[first][0] == "const":
            a, b = self.constant(self.nodes[a][3] * self.nodes[first][3]), second
        if self.nodes[a][0] != "const":
            a, b = min(a, b), max(a, b)
        return self._node(("mul", a, b, 1.0)), 1.0

    def sum(self, i: int, j: int, sign: float) -> tuple[int, float]:
        """Return node and sign of ``i + sign j``."""
        if i == j:
            return (self.product(self.constant(2.0), i)) if sign > 0 else (-1, 0.0)
        flip = -1.0 if (sign < 0 and j < i) else 1.0
        return self._node(("add", min(i, j), max(i, j), sign)), flip

    def _node(self, node: Node) -> int:
        if node not in self._known:
            self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return self._known[node]

    def compile(self, outputs: Sequence[Expression]) -> tuple[Floats, Ints, Floats, list[int]]:
        """Return start values, operations (a, b, c), signs, and the place of every output."""
        ends = [self._signed(x) for x in outputs]
        uses = self._uses(ends)
        place: dict[int, int] = {}
        start = [0.0] * self.inputs + [0.0, 1.0]
        for k, (kind, first, _, value) in enumerate(self.nodes):
            if uses[k] and kind == "const":
                place[k] = len(start)
                start.append(value)
            elif kind == "in":
                place[k] = first
        fused = self._fused(uses)
        ops: list[tuple[int, int, int]] = []
        sign: list[float] = []
        for k, (kind, i, j, s) in enumerate(self.nodes):
            if not uses[k] or kind in ("in", "const") or k in fused:
                continue
            op, s = self._operation(kind, i, j, s, fused, place)
            ops.append(op)
            place[k] = len(start) + len(ops) - 1
            sign.append(s)
        table = np.array(ops, dtype=np.intp).reshape(-1, 3)
        return np.array(start), table, np.array(sign), [place[k] for k in ends]

    def _signed(self, x: Expression) -> int:
        """Return the node that is ``x`` itself, sign included."""
        if not isinstance(x, Symbol):
            return self.constant(float(x))
        if x.sign > 0:
            return x.node
        return self._node(("mul", self.constant(-1.0), x.node, 1.0))

    def _uses(self, ends: Sequence[int]) -> list[int]:
        """Return how often each node is used by the outputs; an output counts as two."""
        uses = [0] * len(self.nodes)
        for k in ends:
            uses[k] += 2
        for k in reversed(range(len(self.nodes))):
            kind, i, j, _ = self.nodes[k]
            if uses[k] and kind in ("mul", "add"):
                uses[i] += 1
                uses[j] += 1
        return uses

    def _fused(self, uses: Sequence[int]) -> set[int]:
        """Return the products that live in the one sum that uses them; at most one a sum."""
        found: set[int] = set()
        for k, (kind, i, j, sign) in enumerate(self.nodes):
            if uses[k] and kind == "add":
                terms = [j] if sign < 0 else [j, i]
                own = [x for x in terms if uses[x] == 1 and self.nodes[x][0] == "mul"]
                found.update(own[:1])
        return found

    def _operation(
        self, kind: str, i: int, j: int, sign: float, fused: set[int], place: dict[int, int]
    ) -> tuple[tuple[int, int, int], float]:
        """Return a, b, c and s of one node."""
        zero, one = self.inputs, self.inputs + 1
        if kind == "mul":
            return (place[i], place[j], zero), 1.0
        if i in fused:
            i, j = j, i
        if j in fused:
            _, a, b, _ = self.nodes[j]
            return (place[a], place[b], place[i]), sign
        return (place[j], one, place[i]), sign


@dataclass(frozen=True, eq=False)
class Symbol:
    """Plus or minus a node."""

    trace: Trace
    node: int
    sign: float

    def __neg__(self) -> Symbol:
        return Symbol(self.trace, self.node, -self.sign)

    def __mul__(self, other: Expression) -> Expression:
        if isinstance(other, Symbol):
            node, sign = self.trace.product(self.node, other.node)
            return Symbol(self.trace, node, sign * self.sign * other.sign)
        if not isinstance(other, float | int):
            return NotImplemented
        size, sign = abs(float(other)), float(np.sign(other))
        if size == 0.0:
            return 0.0
        if size == 1.0:
            return Symbol(self.trace, self.node, sign * self.sign)
        node, own = self.trace.product(self.trace.constant(size), self.node)
        return Symbol(self.trace, node, own * sign * self.sign)

    def __rmul__(self, other: Expression) -> Expression:
        return self * other

    def __add__(self, other: Expression) -> Expression:
        if not isinstance(other, Symbol):
            if not isinstance(other, float | int):
                return NotImplemented
            if other == 0.0:
                return self
            other = Symbol(self.trace, self.trace.constant(abs(float(other))), float(np.sign(other)))
        node, sign = self.trace.sum(self.node, other.node, self.sign * other.sign)
        # i + s j, or j + s i = s (i + s j): the sign of the first term comes out in front.
        return 0.0 if node < 0 else Symbol(self.trace, node, sign * self.sign)

    def __radd__(self, other: Expression) -> Expression:
        return self + other

    def __sub__(self, other: Expression) -> Expression:
        return self + (-other)

    def __rsub__(self, other: Expression) -> Expression:
        return (-self) + other


Expression: TypeAlias = Symbol | float
