"""Laws outside the catalogue, written as expressions: read, checked for units, and run by the engine as programs."""

from polyworld.expressions.parse import Expression, compile_expression
from polyworld.expressions.quantities import FUNCTIONS, VOCABULARY
from polyworld.expressions.units import parse_unit

__all__ = ["FUNCTIONS", "VOCABULARY", "Expression", "compile_expression", "parse_unit"]
