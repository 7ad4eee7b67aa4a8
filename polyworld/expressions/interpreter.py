"""The Warp function that runs the program of an expression: one body, one instant."""

from __future__ import annotations

import warp as wp

from polyworld.effects.law import Motion, Vec8
from polyworld.expressions import program

_PARAMETER_SLOT = program.PARAMETER_SLOT
_END, _CONSTANT, _ADD, _SUB, _MUL = program.END, program.CONSTANT, program.ADD, program.SUB, program.MUL
_DIV, _RATIO, _POW, _NEG, _SIN, _COS = program.DIV, program.RATIO, program.POW, program.NEG, program.SIN, program.COS
_EXP, _LOG, _SQRT, _ABS, _TANH = program.EXP, program.LOG, program.SQRT, program.ABS, program.TANH
_MIN, _MAX, _STEP = program.MIN, program.MAX, program.STEP


class Registers(wp.types.vector(length=program.REGISTERS, dtype=wp.float64)):
    """Working values of one run of a program."""


@wp.func(inline=False)
def expression_acceleration(code: wp.array2d[wp.float64], first: int, p: Vec8, b: Motion) -> wp.vec3d:
    """Acceleration [m/s^2] by the program that begins at row `first` of `code`; see `polyworld.expressions.program`."""
    zero = wp.float64(0.0)
    r = Registers()
    for i in range(3):
        r[i] = b.x[i]
        r[3 + i] = b.v[i]
        r[6 + i] = b.omega[i]
        r[9 + i] = b.gravity[i]
    r[12] = b.t
    r[13] = b.contact
    r[14] = b.mass
    r[15] = b.radius
    for i in range(8):
        r[_PARAMETER_SLOT + i] = p[i]
    k = int(first)
    operation = int(code[k, 0])
    while operation != _END:
        result = code[k, 2]
        if operation != _CONSTANT:
            x = r[int(code[k, 2])]
            y = r[int(code[k, 3])]
            if operation == _MUL:
                result = x * y
            elif operation == _ADD:
                result = x + y
            elif operation == _SUB:
                result = x - y
            elif operation == _DIV:
                result = x / y
            elif operation == _RATIO:
                result = zero
                if y != zero:
                    result = x / y
            elif operation == _NEG:
                result = -x
            elif operation == _SQRT:
                result = wp.sqrt(x)
            elif operation == _POW:
                result = wp.pow(x, y)
            elif operation == _ABS:
                result = wp.abs(x)
            elif operation == _SIN:
                result = wp.sin(x)
            elif operation == _COS:
                result = wp.cos(x)
            elif operation == _EXP:
                result = wp.exp(x)
            elif operation == _LOG:
                result = wp.log(x)
            elif operation == _TANH:
                result = wp.tanh(x)
            elif operation == _MIN:
                result = wp.min(x, y)
            elif operation == _MAX:
                result = wp.max(x, y)
            elif operation == _STEP:
                result = zero
                if x > zero:
                    result = wp.float64(1.0)
        r[int(code[k, 1])] = result
        k += 1
        operation = int(code[k, 0])
    return wp.vec3d(r[int(code[k, 1])], r[int(code[k, 2])], r[int(code[k, 3])])
