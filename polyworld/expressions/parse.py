"""Text of a law into a program: Python's grammar read through a whitelist, nothing of it ever run.

An expression is an acceleration [m/s^2] over the words of `VOCABULARY`, the law's parameters and numbers, with
+ - * / ^ (or **) and the functions of `FUNCTIONS`. A number has no unit unless one follows in brackets: 2[m/s].
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from polyworld.expressions.program import PARAMETER_SLOT, Builder
from polyworld.expressions.quantities import FUNCTIONS, VOCABULARY, Operations, Quantity
from polyworld.expressions.units import ACCELERATION, FORCE, ONE, Dimension, parse_unit, unit_of_tree

MAX_LENGTH = 600  # characters of one expression
MAX_DEPTH = 40  # operations within operations
MAX_EXPRESSION_PARAMETERS = 8


@dataclass(frozen=True)
class Expression:
    """A law as written. text: one vector expression, or those of the components along x, y and z.

    parameters: name and unit of each parameter, in the order in which their values are given.
    """

    text: tuple[str] | tuple[str, str, str]
    parameters: tuple[tuple[str, str], ...] = ()


@lru_cache(maxsize=1024)
def compile_expression(expression: Expression) -> NDArray[np.float64]:
    """The program (rows, 4), read-only, as `polyworld.expressions.program` describes it.

    Raises ValueError that names the term which is unknown, has the wrong unit, or is too large.
    """
    builder = Builder()
    words = _parameters(expression.parameters)
    reader = _Reader(Operations(builder), words)
    if len(expression.text) == 1:
        law = reader.read(expression.text[0])
        if law.dimension is None and not law.vector:
            law = Quantity(law.parts * 3, None, law.text)
        if not law.vector:
            raise ValueError(
                f"{law.described()} is a number, but a force has a direction: multiply by a vector such as unit(v) "
                "or ez, or give the components x, y and z"
            )
        _must_be_acceleration(law, "the expression")
        outputs = law.parts
    else:
        outputs = ()
        for axis, text in zip("xyz", expression.text, strict=True):
            law = reader.read(text)
            if law.vector:
                raise ValueError(f"component {axis} is {law.described()}, but must be a number: write .{axis} after it")
            _must_be_acceleration(law, f"component {axis}")
            outputs += law.parts
    unused = sorted(set(words) - reader.used)
    if unused:
        raise ValueError(f"parameters {unused} are not in the expression")
    made = builder.finish((outputs[0], outputs[1], outputs[2]))
    made.setflags(write=False)
    return made


def _parameters(listed: tuple[tuple[str, str], ...]) -> dict[str, tuple[int, Dimension]]:
    if len(listed) > MAX_EXPRESSION_PARAMETERS:
        raise ValueError(f"an expression has at most {MAX_EXPRESSION_PARAMETERS} parameters, got {len(listed)}")
    found = {}
    for slot, (name, unit) in enumerate(listed):
        if not (name.isidentifier() and name.isascii()):
            raise ValueError(f"{name!r} is no name for a parameter: letters, digits and _ only, a letter first")
        if name in VOCABULARY or name in FUNCTIONS:
            raise ValueError(f"parameter {name!r} has the name of something in the vocabulary; rename it")
        found[name] = (PARAMETER_SLOT + slot, parse_unit(unit))
    return found


def _must_be_acceleration(law: Quantity, what: str) -> None:
    if law.dimension in (None, ACCELERATION):
        return
    hint = "; this is a force: divide it by mass" if law.dimension == FORCE else ""
    raise ValueError(f"{what} must be an acceleration ({ACCELERATION}), but {law.described()}{hint}")


class _Reader:
    """Walks the syntax tree; `used` collects the parameters met."""

    def __init__(self, operations: Operations, parameters: Mapping[str, tuple[int, Dimension]]) -> None:
        self.operations = operations
        self.parameters = parameters
        self.functions = operations.functions()
        self.used: set[str] = set()

    def read(self, text: str) -> Quantity:
        """The quantity that a text stands for."""
        if len(text) > MAX_LENGTH:
            raise ValueError(f"an expression has at most {MAX_LENGTH} characters, got {len(text)}")
        try:
            tree = ast.parse(text.strip().replace("^", "**"), mode="eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            where = getattr(error, "offset", None)
            near = f" near character {where}" if where else ""
            raise ValueError(f"{text!r} cannot be read{near}; write for example '-k*speed*v'") from None
        return self._visit(tree.body, 0)

    def _visit(self, node: ast.expr, depth: int) -> Quantity:
        if depth > MAX_DEPTH:
            raise ValueError(f"the expression is nested more than {MAX_DEPTH} deep")
        text = _text(node)
        do = self.operations
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return do.constant(_finite(value, text), ONE, text)
            case ast.Subscript(value=ast.Constant(value=int() | float() as value), slice=unit):
                shown = _text(unit)
                return do.constant(_finite(value, text), unit_of_tree(unit, shown), text)
            case ast.Name(id=name):
                return self._word(name)
            case ast.Attribute(value=inner, attr="x" | "y" | "z" as axis):
                return do.component(self._visit(inner, depth + 1), "xyz".index(axis), text)
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return do.negative(self._visit(inner, depth + 1), text)
            case ast.UnaryOp(op=ast.UAdd(), operand=inner):
                return self._visit(inner, depth + 1)
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
                apply = getattr(do, _OPERATORS[type(operator)])
                made: Quantity = apply(self._visit(left, depth + 1), self._visit(right, depth + 1), text)
                return made
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._call(name, arguments, depth, text)
        raise ValueError(
            f"{text!r} is not part of the language; it has + - * / ^, the functions {', '.join(FUNCTIONS)}, "
            "components such as x.z, and numbers with a unit such as 2[m/s]"
        )

    def _word(self, name: str) -> Quantity:
        if name in self.parameters:
            self.used.add(name)
            slot, dimension = self.parameters[name]
            return Quantity((slot,), dimension, name)
        known = self.operations.known(name)
        if known is None:
            raise ValueError(
                f"unknown word {name!r}; words: {', '.join(VOCABULARY)}; parameters: {list(self.parameters)}"
            )
        return known

    def _call(self, name: str, arguments: list[ast.expr], depth: int, text: str) -> Quantity:
        if name not in self.functions:
            raise ValueError(f"unknown function {name!r}; functions: {', '.join(FUNCTIONS)}")
        count, apply = self.functions[name]
        if len(arguments) != count:
            raise ValueError(f"{name} takes {count} argument{'s' if count > 1 else ''}, got {len(arguments)}: {text!r}")
        return apply(*(self._visit(a, depth + 1) for a in arguments), text)


_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "subtract",
    ast.Mult: "multiply",
    ast.Div: "divide",
    ast.Pow: "power",
}


def _text(node: ast.expr) -> str:
    return ast.unparse(node).replace(" ** ", "^").replace("**", "^")


def _finite(value: float, text: str) -> float:
    if not abs(value) < 1e300:
        raise ValueError(f"{text!r} is too large a number")
    return float(value)
