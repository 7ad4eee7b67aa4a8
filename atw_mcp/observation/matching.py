"""Which observed object is which known one: a one-to-one assignment by colour, shape, apparent size and place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.eye.colour_names import WORDS, chances, colour_word
from atw_mcp.perception.naming import SYNONYMS
from atw_mcp.perception.observation import Cue, ObservedObject
from atw_mcp.perception.sizes import SolidEstimate
from polyworld.world.camera import Camera
from polyworld.world.geometry import equivalent_radius
from polyworld.world.shapes import BodyShape, Box, Capsule, Cylinder, Sphere

KINDS = ("sphere", "cylinder", "cube")
MATERIALS = ("metal", "rubber")
NAMED_FAR = 0.005  # probability that a colour gets a name that is far off, whatever the survey says
NAMED_CLEAR = 0.9  # probability that a clear look is named rightly
SIZE_SIGMA = 0.15  # of ln(size): blurred edges 0.1, an outline that turns with the body 0.1
SIZE_SPREAD = 0.5  # of ln(size) among the bodies of one scene
SLIPS = 0.05  # share of cues that mislead whatever they say: a shadow in the mask, a hint that is wrong
SHARPNESS = 6.0  # power of the outline's misfit by which kinds of solid compete, as where sizes are estimated
EXPECTED = float(np.log(9.0))  # log odds that a known object is in view at all: 0.9 to 0.1
SURE = float(np.log(19.0))  # margin [nats] from which a match counts as sure: 0.95 to 0.05
OFF_SIZE = 1.3  # ratio of seen to known size beyond which one of them is wrong


@dataclass(frozen=True)
class Known:
    """A known object; None where nothing is said. pixel: a place on it in `frame`, else in the first that shows it."""

    name: str
    shape: BodyShape | None = None
    color: str | None = None
    material: str | None = None
    pixel: tuple[float, float] | None = None
    frame: int | None = None

    @property
    def colour(self) -> str | None:
        """The colour as perception names it, from the hint or else from the name."""
        return colour_word(self.name if self.color is None else self.color)

    @property
    def stuff(self) -> str | None:
        """metal or rubber, from the hint or else from the name."""
        found = [word for word in _words(self.material or self.name) if word in MATERIALS]
        return found[-1] if found else None

    @property
    def kind(self) -> str | None:
        """sphere, cylinder or cube (any box), from the shape or else from the name; None for other shapes."""
        if self.shape is None:
            found = [word for word in _words(self.name) if word in KINDS]
            return found[-1] if found else None
        kinds: list[tuple[type, str]] = [(Sphere, "sphere"), (Cylinder, "cylinder"), (Box, "cube")]
        return next((kind for form, kind in kinds if isinstance(self.shape, form)), None)


@dataclass(frozen=True)
class Match:
    """A known object and the track taken for it. margin: by how much the log likelihood of the best assignment falls
    without this pair [nats]; cues: log likelihood ratio of each cue, against any other body."""

    known: str
    track: str
    margin: float
    cues: dict[str, float]
    size_ratio: float | None
    notes: tuple[str, ...] = ()

    @property
    def confidence(self) -> float:
        """Probability of this pair against the best assignment without it."""
        return float(1.0 / (1.0 + np.exp(-self.margin)))

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "object": self.known,
            "track": self.track,
            "confidence": round(self.confidence, 3),
            "margin": round(self.margin, 2),
            "cues": {cue: round(value, 2) for cue, value in self.cues.items()},
            "seen_over_known_size": None if self.size_ratio is None else round(self.size_ratio, 3),
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class Matching:
    """Matches, known objects without a track, and tracks that no known object explains.

    looked_for: known objects that were found by colour and size, which need no match.
    """

    matches: tuple[Match, ...]
    unseen: tuple[str, ...]
    unlisted: tuple[str, ...]
    looked_for: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether every known object has a track for sure, and every track is one."""
        return not self.unseen and not self.unlisted and all(match.margin >= SURE for match in self.matches)

    @property
    def doubts(self) -> list[str]:
        """Return what is doubtful about the assignment, in sentences."""
        found = [
            f"{match.known} may be another track than {match.track} (confidence {match.confidence:.2f}): give more of "
            "its color, material, shape, or a pixel on it"
            for match in self.matches
            if match.margin < SURE
        ]
        found += [f"{match.known}: {note}" for match in self.matches for note in match.notes]
        ratios = [match.size_ratio for match in self.matches if match.size_ratio is not None]
        if len(ratios) > 1 and max(1.0 / max(ratios), min(ratios)) > OFF_SIZE:
            found.append(
                f"all objects look {np.median(ratios):.2g} times as large as known: check the camera's points or "
                "length, and whether sizes are radii or diameters"
            )
        if self.unseen:
            found.append(f"no track fits {', '.join(self.unseen)}")
        if self.unlisted:
            found.append(f"no listed object fits {_tracks(self.unlisted)}")
        return found


def matched(
    known: Sequence[Known],
    seen: Sequence[ObservedObject],
    estimates: dict[str, SolidEstimate],
    elevation: float,
) -> Matching:
    """Assign observed objects to known ones by maximum likelihood; each is taken at most once.

    elevation: angle at which the camera looks down [rad]. Every cue is a log likelihood ratio against a body about
    which nothing is known, and bounded, so that no single wrong cue decides. A known object stays without a track
    where none is more likely to be it than to be something else, given that it is probably in view.
    """
    cues = [[_cues(item, track, estimates.get(track.name), elevation) for track in seen] for item in known]
    gain = np.array([[sum(pair.values()) + EXPECTED for pair in row] for row in cues]).reshape(len(known), len(seen))
    total, chosen = _best(gain)
    matches = []
    for k, t in chosen:
        without = gain.copy()
        without[k, t] = -np.inf
        ratio = _size_ratio(known[k].shape, estimates.get(seen[t].name), elevation)
        notes = _notes(known[k], seen[t], estimates.get(seen[t].name), ratio)
        margin = float(total - _best(without)[0])
        matches.append(Match(known[k].name, seen[t].name, margin, cues[k][t], ratio, tuple(notes)))
    taken = {match.track for match in matches}
    placed = {match.known for match in matches}
    return Matching(
        tuple(matches),
        tuple(item.name for item in known if item.name not in placed),
        tuple(track.name for track in seen if track.name not in taken),
    )


def _best(gain: NDArray[np.float64]) -> tuple[float, list[tuple[int, int]]]:
    """The greatest total gain of a one-to-one assignment, and its pairs; a row may stay alone at no gain."""
    rows, columns = gain.shape
    padded = np.hstack([np.where(np.isfinite(gain), gain, -1e9), np.zeros((rows, rows))])
    chosen = zip(*linear_sum_assignment(padded, maximize=True), strict=True)
    pairs = [(int(k), int(t)) for k, t in chosen if t < columns and gain[k, t] > 0.0]
    return sum(float(gain[k, t]) for k, t in pairs), pairs


def _cues(item: Known, track: ObservedObject, estimate: SolidEstimate | None, elevation: float) -> dict[str, float]:
    found = {}
    if item.colour is not None and track.colour.measured:
        found["colour"] = _colour(item.colour, track.colour)
    if item.stuff is not None and track.material.name in MATERIALS:
        found["material"] = _material(track.material.name == item.stuff, track.material.confidence)
    if item.kind is not None and estimate is not None:
        found["shape"] = _shape(item.kind, track, estimate)
    ratio = _size_ratio(item.shape, estimate, elevation)
    if ratio is not None:
        found["size"] = _size(float(np.log(ratio)))
    if item.pixel is not None:
        found["place"] = _place(item.pixel, track)
    return found


def _colour(word: str, seen: Cue) -> float:
    share = chances(np.array([[round(seen.measured[channel]) for channel in "bgr"]], np.uint8))[word]
    return float(np.log((1.0 - NAMED_FAR) * share * len(WORDS) + NAMED_FAR))


def _material(same: bool, confidence: float) -> float:
    clear = NAMED_CLEAR if same else 1.0 - NAMED_CLEAR
    return float(np.log((confidence * clear + (1.0 - confidence) * 0.5) * len(MATERIALS)))


def _shape(kind: str, track: ObservedObject, estimate: SolidEstimate) -> float:
    weights = {}
    for option in KINDS:
        misfits = [estimate.alternatives[k] for k in (("cube", "box") if option == "cube" else (option,)) if
                   k in estimate.alternatives]  # fmt: skip
        agrees = track.shape.name == option or (track.shape.name == "box" and option == "cube")
        look = 1.0 + track.shape.confidence if agrees else 1.0
        weights[option] = look * max(min(misfits), 0.1) ** -SHARPNESS if misfits else 0.0
    share = weights[kind] / max(sum(weights.values()), 1e-300)
    return float(np.log((1.0 - SLIPS) * share * len(KINDS) + SLIPS))


def _size(difference: float) -> float:
    def density(sigma: float) -> float:
        return float(np.exp(-0.5 * (difference / sigma) ** 2) / sigma)

    return float(np.log((1.0 - SLIPS) * density(SIZE_SIGMA) / max(density(SIZE_SPREAD), 1e-12) + SLIPS))


def _place(pixel: tuple[float, float], track: ObservedObject) -> float:
    """Whether the pixel lies in the track's box in its first frame, against anywhere in twenty times that area."""
    rows = np.flatnonzero(np.isfinite(track.box).all(axis=1))
    if len(rows) == 0:
        return 0.0
    left, top, width, height = track.box[rows[0]]
    inside = left <= pixel[0] <= left + width and top <= pixel[1] <= top + height
    return float(np.log((1.0 - SLIPS) * 20.0 if inside else SLIPS))


def _size_ratio(shape: BodyShape | None, estimate: SolidEstimate | None, elevation: float) -> float | None:
    if shape is None or estimate is None:
        return None
    return apparent_radius(estimate.solid, elevation) / apparent_radius(shape, elevation)


def elevation_of(camera: Camera) -> float:
    """Return the angle at which a camera looks down [rad]."""
    return float(np.arcsin(np.clip(-np.asarray(camera.rotation)[2, 2], -1.0, 1.0)))


def apparent_radius(shape: BodyShape, elevation: float) -> float:
    """Radius of the disc with the area that an upright body shows from an elevation [rad], averaged over its turns [m].

    A box about the vertical shows its sides with 2/pi of their sum; other shapes are taken for balls of their volume.
    """
    above, beside = abs(np.sin(elevation)), abs(np.cos(elevation))
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Cylinder | Capsule):
        area = np.pi * shape.radius**2 * (above if isinstance(shape, Cylinder) else 1.0)
        area += 4.0 * shape.radius * shape.half_height * beside
    elif isinstance(shape, Box):
        a, b, c = shape.half_extents
        area = 4.0 * a * b * above + 4.0 * c * (a + b) * (2.0 / np.pi) * beside
    else:
        return equivalent_radius(shape)
    return float(np.sqrt(area / np.pi))


def _notes(item: Known, track: ObservedObject, estimate: SolidEstimate | None, ratio: float | None) -> list[str]:
    notes = []
    if item.colour not in (None, track.colour.name.replace("gray", "grey")) and track.colour.measured:
        notes.append(f"known as {item.colour}, seen as {track.colour.name} ({track.colour.confidence:.2f})")
    if ratio is not None and not 1.0 / OFF_SIZE < ratio < OFF_SIZE:
        notes.append(f"its outline is {ratio:.2g} times as large as its known size")
    if item.kind is not None and estimate is not None and _shape(item.kind, track, estimate) < -1.0:
        notes.append(f"known as a {item.kind}, its outline fits a {track.shape.name} better")
    return notes


def _words(text: str) -> list[str]:
    return [SYNONYMS.get(word, word) for word in re.findall(r"[a-z]+", text.lower())]


def _tracks(names: Sequence[str]) -> str:
    return f"track {names[0]}" if len(names) == 1 else f"tracks {', '.join(names)}"
