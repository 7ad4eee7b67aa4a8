"""Names for observed objects, from how they look or from what the caller expects to find."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.eye.colour_names import colour_word
from atw_mcp.perception.observation import Cue, ImageObservation, ObservedObject

CLEAR = 0.55  # confidence from which a cue goes into a name
SYNONYMS = {
    "ball": "sphere",
    "disc": "sphere",
    "disk": "sphere",
    "circle": "sphere",
    "block": "cube",
    "box": "cube",
    "square": "cube",
    "can": "cylinder",
    "metallic": "metal",
    "shiny": "metal",
    "matte": "rubber",
}


def names_for(cues: list[tuple[Cue, Cue, Cue]]) -> list[str]:
    """Return a unique name for each (colour, material, shape), such as blue_sphere.

    The material, the least certain of the three, comes in only where colour and shape are shared by several
    objects and their materials differ: blue_rubber_sphere, blue_metal_sphere. What is still alike is numbered.
    """
    plain = []
    for colour, _, shape in cues:
        solid = shape.name if shape.confidence >= CLEAR and shape.name not in ("other", "unknown") else "object"
        plain.append(f"{colour.name}_{solid}" if colour.confidence >= CLEAR else solid)
    named = list(plain)
    for name in set(plain):
        alike = [k for k, n in enumerate(plain) if n == name]
        if len({cues[k][1].name for k in alike}) > 1:
            for k in alike:
                words = name.split("_")
                named[k] = "_".join([*words[:-1], cues[k][1].name, words[-1]])
    return unique(named)


def unique(names: list[str]) -> list[str]:
    """Return the names, with _2, _3, ... behind repeated ones."""
    taken: set[str] = set()
    counts: Counter[str] = Counter()
    result = []
    for name in names:
        counts[name] += 1
        candidate = name if counts[name] == 1 else f"{name}_{counts[name]}"
        while candidate in taken:
            counts[name] += 1
            candidate = f"{name}_{counts[name]}"
        taken.add(candidate)
        result.append(candidate)
    return result


def slug(text: str) -> str:
    """Turn a description into a name: letters, digits and underscores."""
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")[:64] or "object"


def matched_to_expected(
    observation: ImageObservation, expected: tuple[str, ...]
) -> tuple[ImageObservation, tuple[str, ...]]:
    """Return the observation with objects renamed to the descriptions they fit best, and the descriptions left over."""
    if not observation.objects:
        return observation, expected
    cost = [[_mismatch(o, e) for e in expected] for o in observation.objects]
    names = list(observation.names)
    found = set()
    for i, j in zip(*linear_sum_assignment(cost), strict=True):
        if cost[i][j] < 0.5:
            names[i] = slug(expected[j])
            found.add(int(j))
    objects = tuple(replace(o, name=n) for o, n in zip(observation.objects, unique(names), strict=True))
    return replace(observation, objects=objects), tuple(e for j, e in enumerate(expected) if j not in found)


def _mismatch(candidate: ObservedObject, description: str) -> float:
    """0 where every word of the description that names a look fits the object; 1 where none does."""
    words = [SYNONYMS.get(w, w) for w in re.findall(r"[a-z]+", description.lower())]
    colour = colour_word(description)
    said = [] if colour is None else [(candidate.colour, colour.replace("grey", "gray"), 1.0)]
    said += [(candidate.material, w, 0.5) for w in words if w in ("metal", "rubber")]
    said += [(candidate.shape, w, 0.7) for w in words if w in ("sphere", "cylinder", "cube")]
    wrong = [w * cue.confidence for cue, word, w in said if word != ("cube" if cue.name == "box" else cue.name)]
    return sum(wrong) / sum(weight for *_, weight in said) if said else 0.4
