"""Plan the cases of each section."""

from numpy.random import Generator

from .cases import Plan
from .effects import GROUPS, RIGS
from .near import TABLE, near_plan
from .observe import KINDS
from .walls import VARIANTS

SECTIONS = ("one", "nothing", "pairs", "walls_and_places", "contaminated", "near_misses", "discs")
DISC_LAWS = (
    "friction_error",
    "restitution_error",
    "tilt",
    "linear_drag",
    "quadratic_drag",
    "fan",
    "spring",
    "friction_patch",
    "coriolis",
    "mass_error",
    "hidden_wall",
    "nothing",
)
CONTAMINATED = ("quadratic_drag", "linear_drag", "magnus_lift", "tilt", "restitution_error", "gravity_error", "nothing")


def _weak(rng: Generator) -> bool:
    return bool(rng.random() < 0.2)


def _rig(rng: Generator, name: str) -> str:
    return str(rng.choice(RIGS[name]))


def plans(section: str, style: str, count: int, rng: Generator) -> list[Plan]:
    """`count` plans of a section; effects are taken in shuffled turns so that each comes up before any repeats."""
    if section == "one":
        names = _turns(rng, list(RIGS), count)
        return [Plan(section, style, _rig(rng, n), [n], weak=_weak(rng)) for n in names]
    if section == "nothing":
        rigs = _turns(rng, ["flight", "bounce", "bounce*", "roll", "puck", "flight*"], count)
        kinds = _turns(rng, list(KINDS), count)
        return [Plan(section, style, r, [], noise_kind=k) for r, k in zip(rigs, kinds, strict=True)]
    if section == "pairs":
        return [_pair(rng, style) for _ in range(count)]
    if section == "walls_and_places":
        return _walls(rng, style, count)
    if section == "contaminated":
        out = []
        for n in _turns(rng, list(CONTAMINATED), count):
            rig = str(rng.choice(["flight", "bounce"])) if n in ("nothing", "tilt", "linear_drag") else _rig(rng, n)
            effects = [] if n == "nothing" else [n]
            out.append(
                Plan(section, style, rig, list(effects), weak=_weak(rng), launches=12, bad=int(rng.integers(1, 4)))
            )
        return out
    if section == "near_misses":
        return near_plan(rng, style, _turns(rng, list(TABLE), count))
    if section == "discs":
        return [_disc_plan(rng, style, n) for n in _turns(rng, list(DISC_LAWS), count)]
    raise KeyError(section)


def _turns(rng: Generator, names: list[str], count: int) -> list[str]:
    out: list[str] = []
    while len(out) < count:
        out.extend(str(n) for n in rng.permutation(names))
    return out[:count]


def _pair(rng: Generator, style: str) -> Plan:
    """Return two effects that share a rig and are not of one group of look-alikes."""
    while True:
        a, b = (str(n) for n in rng.choice(list(RIGS), 2, replace=False))
        if any(a in g and b in g for g in GROUPS):
            continue
        shared = sorted(set(RIGS[a]) & set(RIGS[b]))
        if not shared:  # an orientation or smoothness mark does no harm to the other effect
            plain = {r.strip("*0"): r for r in RIGS[a] + RIGS[b] if len(r.strip("*0")) < len(r)}
            both = {r.strip("*0") for r in RIGS[a]} & {r.strip("*0") for r in RIGS[b]}
            shared = sorted(plain[r] for r in both if r in plain)
        if not shared:
            continue
        rig = str(rng.choice(shared))
        if "0" in rig and {a, b} & {"friction_error", "spin_damping"}:
            continue
        return Plan("pairs", style, rig, [a, b], weak=_weak(rng))


def _walls(rng: Generator, style: str, count: int) -> list[Plan]:
    out = []
    kinds = ["hidden_wall"] * 5 + ["friction_patch", "fan", "spring", "observer_distortion", "tether"]
    variants = _turns(rng, list(VARIANTS), count)
    for n, variant in zip(_turns(rng, kinds, count), variants, strict=True):
        rig = "flight" if n == "hidden_wall" and variant in ("slanted", "second") else _rig(rng, n)
        out.append(
            Plan(
                "walls_and_places",
                style,
                rig,
                [n],
                weak=_weak(rng),
                levels=(0.01, 0.03),
                options={"variant": variant, "relative": True},
            )
        )
    return out


def _disc_plan(rng: Generator, style: str, name: str) -> Plan:
    n = int(rng.integers(2, 5))
    rig = "discs*" if rng.random() < 0.5 else "discs"
    return Plan("discs", style, rig, [] if name == "nothing" else [name], weak=_weak(rng), discs=n, min_rate=60.0)
