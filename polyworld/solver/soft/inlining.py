"""Compiler options for the kernels of soft bodies."""

from polyworld.solver.spatial.layout import OPTIONS

# Everything inlined: the small matrices of an element then stay in registers, which nearly halves the time of a
# step; the kernels are few, so that compiling them takes half a second more.
INLINED: dict[str, object] = {**OPTIONS, "cpu_compiler_flags": "-march=native -mllvm -inline-threshold=10000"}
