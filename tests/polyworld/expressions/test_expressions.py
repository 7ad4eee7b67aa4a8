"""Laws as expressions: what is read, what is refused, and that the engine computes what was written."""

import numpy as np
import pytest
import warp as wp

from polyworld.effects.law import Motion, Vec8
from polyworld.expressions import Expression, compile_expression, parse_unit
from polyworld.expressions.interpreter import expression_acceleration

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def run_program(
    code: wp.array2d[wp.float64], motions: wp.array[Motion], p: wp.array[Vec8], out: wp.array[wp.vec3d]
) -> None:
    i = wp.tid()
    out[i] = expression_acceleration(code, 0, p[i], motions[i])


STATE = {
    "x": np.array([0.3, -1.2, 0.7]),
    "v": np.array([1.5, 0.4, -2.1]),
    "omega": np.array([-0.6, 2.2, 0.9]),
    "g": np.array([0.0, 0.5, -9.81]),
    "t": 1.3,
    "contact": 1.0,
    "mass": 2.5,
    "radius": 0.12,
    "a": 0.8,
    "b": -0.35,
}


def computed(text: str | tuple[str, str, str], parameters: dict[str, tuple[float, str]] | None = None) -> np.ndarray:
    """Evaluate an expression at STATE by the engine."""
    given = parameters or {}
    written = (text,) if isinstance(text, str) else text
    program = compile_expression(Expression(written, tuple((n, u) for n, (_, u) in given.items())))
    motion = Motion()
    for name in ("x", "v", "omega"):
        setattr(motion, name, wp.vec3d(*STATE[name]))
    motion.gravity = wp.vec3d(*STATE["g"])
    for name in ("t", "contact", "mass", "radius"):
        setattr(motion, name, STATE[name])
    values = [v for v, _ in given.values()] + [0.0] * (8 - len(given))
    out = wp.zeros(1, dtype=wp.vec3d, device="cpu")
    code = wp.array(np.array(program), dtype=wp.float64, device="cpu")
    motions = wp.array([motion], dtype=Motion, device="cpu")
    wp.launch(run_program, 1, [code, motions, wp.array([Vec8(*values)], dtype=Vec8, device="cpu"), out], device="cpu")
    return np.asarray(out.numpy()[0])


v, omega, x, g = STATE["v"], STATE["omega"], STATE["x"], STATE["g"]
speed = np.linalg.norm(v)


@pytest.mark.parametrize(
    ("text", "parameters", "expected"),
    [
        ("-k*speed*v", {"k": (0.2, "1/m")}, -0.2 * speed * v),
        ("-k*(speed/1[m/s])^p*unit(v)", {"k": (0.3, "m/s^2"), "p": (1.5, "1")}, -0.3 * speed**0.5 * v),
        ("-k*speed^(2 - 3/2)*v", {"k": (0.3, "m^-0.5 s^-0.5")}, -0.3 * speed**0.5 * v),
        ("s*cross(omega, v)", {"s": (0.4, "1")}, 0.4 * np.cross(omega, v)),
        ("k*x.x*x.z*ez", {"k": (2.0, "1/(m s^2)")}, np.array([0, 0, 2.0 * x[0] * x[2]])),
        ("a*exp(-t/tau)*ex", {"a": (3.0, "m/s^2"), "tau": (0.5, "s")}, np.array([3.0 * np.exp(-1.3 / 0.5), 0, 0])),
        (("-k*abs(vx)*vx", "-k*abs(vy)*vy", "0"), {"k": (0.1, "1/m")}, -0.1 * np.abs(v) * v * [1, 1, 0]),
        ("-c*v/mass", {"c": (0.7, "kg/s")}, -0.7 * v / 2.5),
        ("a*sin(6.28*f*t)*ey*contact", {"a": (1.0, "m/s^2"), "f": (2.0, "Hz")}, [0, np.sin(6.28 * 2 * 1.3), 0]),
        ("dot(g, unit(v))*unit(v)", {}, (g @ v) / speed**2 * v),
        ("step(x.z - 1[m])*g + step(1[m] - x.z)*min(2, 3)*g", {}, 2 * g),
        ("max(0, -vz)*spin*tanh(2)*ex", {}, [2.1 * np.linalg.norm(omega) * np.tanh(2), 0, 0]),
        ("-2^2*g", {}, -4 * g),
        ("2^-1*g/2/2", {}, g / 8),
        ("0", {}, [0, 0, 0]),
    ],
)
def test_engine_computes_what_is_written(text, parameters, expected):
    np.testing.assert_allclose(computed(text, parameters), expected, rtol=1e-13, atol=1e-13)


def test_direction_of_nothing_is_nothing():
    np.testing.assert_array_equal(computed("1[m/s^2]*unit(v - v)"), 0.0)


class RandomExpressions:
    """Random text without units, grown together with its value."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def number(self, depth: int) -> tuple[str, float]:
        if depth == 0:
            leaves = [("a", 0.8), ("b", -0.35), ("contact", 1.0), ("(t/1[s])", 1.3), ("vx/1[m/s]", 1.5), ("0.75", 0.75)]
            return leaves[self.rng.integers(len(leaves))]
        one, x = self.number(depth - 1)
        two, y = self.number(depth - 1)
        forms = [
            (f"({one} + {two})", x + y),
            (f"({one} - {two})", x - y),
            (f"({one})*({two})", x * y),
            (f"({one})/(2 + abs({two}))", x / (2 + abs(y))),
            (f"(1 + abs({one}))^tanh({two})", (1 + abs(x)) ** np.tanh(y)),
            (f"sqrt(abs({one}))", np.sqrt(abs(x))),
            (f"sin({one})*cos({two})", np.sin(x) * np.cos(y)),
            (f"exp(-abs({one}))", np.exp(-abs(x))),
            (f"log(1 + abs({one}))", np.log(1 + abs(x))),
            (f"min({one}, {two})", min(x, y)),
            (f"max({one}, {two})", max(x, y)),
            (f"-({one})", -x),
            (f"({one})^3", x**3),
            (f"step({one})", float(x > 0)),
        ]
        if depth > 1:
            three, u = self.vector(depth - 2)
            four, w = self.vector(depth - 2)
            forms += [(f"dot({three}, {four})", u @ w), (f"norm({three})", np.linalg.norm(u)), (f"({three}).y", u[1])]
        return forms[self.rng.integers(len(forms))]

    def vector(self, depth: int) -> tuple[str, np.ndarray]:
        if depth == 0:
            leaves = [("v/1[m/s]", v), ("x/1[m]", x), ("omega*1[s]", omega), ("ez", np.array([0.0, 0.0, 1.0]))]
            return leaves[self.rng.integers(len(leaves))]
        one, u = self.vector(depth - 1)
        two, w = self.vector(depth - 1)
        three, k = self.number(depth - 1)
        length = np.linalg.norm(u)
        forms = [
            (f"({one} + {two})", u + w),
            (f"({one} - {two})", u - w),
            (f"cross({one}, {two})", np.cross(u, w)),
            (f"({three})*({one})", k * u),
            (f"({one})/(1 + abs({three}))", u / (1 + abs(k))),
            (f"unit({one})", u / length if length > 0 else u),
        ]
        return forms[self.rng.integers(len(forms))]


@pytest.mark.parametrize("seed", range(60))
def test_random_expressions_equal_numpy(seed):
    text, expected = RandomExpressions(seed).vector(3)
    program_text = f"(a - a + b - b)*g + 1[m/s^2]*({text})"
    if len(program_text) > 600:
        pytest.skip("longer than an expression may be")
    made = computed(program_text, {"a": (0.8, "1"), "b": (-0.35, "1")})
    np.testing.assert_allclose(made, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "parameters", "message"),
    [
        ("v", (), r"must be an acceleration \(m/s\^2\), but 'v' \(vector, m/s\)"),
        ("-c*v", (("c", "kg/s"),), "this is a force: divide it by mass"),
        ("g + v", (), r"'g' \(vector, m/s\^2\) and 'v' \(vector, m/s\)"),
        ("speed^p*g", (("p", "1"),), r"divide it by one of its unit: \(speed/1\[m/s\]\)\^p"),
        ("sin(t)*g", (), "must have no unit, but 't'"),
        ("speed^(1[s])*g", (), "must be a number without unit"),
        ("v*v", (), r"dot\(a, b\) or cross"),
        ("g/v", (), "divides by the vector"),
        ("1[m/s^2]", (), "a force has a direction"),
        ("k*q*g", (("k", "1"),), "unknown word 'q'"),
        ("g", (("k", "1"),), r"parameters \['k'\] are not in the expression"),
        ("v*g", (("v", "1"),), "has the name of something in the vocabulary"),
        ("k*g", (("k", "furlong"),), "unknown unit 'furlong'"),
        ("norm(1)*g", (), "needs a vector"),
        ("abs(v)*g", (), "needs a number"),
        ("max(1)*g", (), "max takes 2 arguments, got 1"),
        ("g*(1 if t else 2)", (), "not part of the language"),
        ("__import__('os').system('true')", (), "not part of the language"),
        ("[g for k in x]", (), "not part of the language"),
        ("x.__class__", (), "not part of the language"),
        ("(lambda: g)()", (), "not part of the language"),
        ("True*g", (), "not part of the language"),
        ("g*", (), "cannot be read"),
        ("g/0", (), "divides by zero"),
        ("2*" * 400 + "g", (), "at most 600 characters"),
        ("-" * 100 + "g", (), "nested more than 40 deep"),
        ("(" * 250 + "g" + ")" * 250, (), "cannot be read"),
        ("1e999*g", (), "too large a number"),
        ("k*g", tuple((f"k{i}", "1") for i in range(9)), "at most 8 parameters"),
    ],
)
def test_what_cannot_be_a_law_is_refused_by_name(text, parameters, message):
    with pytest.raises(ValueError, match=message):
        compile_expression(Expression((text,), parameters))


def test_too_many_operations_are_refused():
    terms = ["+".join(f"sin({i}.{axis}*t/1[s])" for i in range(1, 25)) for axis in "123"]
    with pytest.raises(ValueError, match="operations; at most 255 are run"):
        compile_expression(Expression(tuple(f"({t})*1[m/s^2]" for t in terms), ()))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("m/s^2", "m/s^2"),
        ("N/kg", "m/s^2"),
        ("kg/(m s)", "kg/(m s)"),
        ("Pa s", "kg/(m s)"),
        ("m^-0.5 s^-0.5", "1/(m^0.5 s^0.5)"),
        ("m^(1/2)", "m^0.5"),
        ("1/s", "1/s"),
        ("rad/s", "1/s"),
        ("1", "1"),
    ],
)
def test_units_are_read(text, shown):
    assert str(parse_unit(text)) == shown


@pytest.mark.parametrize("text", ["m/s kg", "mm", "", "m^s", "2 m", "m**1000", "m/0", "__import__('os')"])
def test_what_is_no_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"unit|two ways"):
        parse_unit(text)
