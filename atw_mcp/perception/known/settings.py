"""The numbers by which known bodies are looked for, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.world.settings_checks import require_positive, require_shares

SHARES = (
    *(
        "shades",
        "dim",
        "any_colour",
        "shadow",
        "other",
        "soft",
        "goes_on",
        "least_inside",
        "rare",
        "within",
        "piece",
        "smaller",
    ),
    *("nearer_than", "core"),
)


@dataclass(frozen=True)
class KnownSettings:
    """Units: logarithms of likelihoods per pixel [nats] relative to a typical body's colours; lengths in a body's radii
    in the image; brightness and colour levels of 255.

    Where a body may be
        nearer_than, farther_than: parts of the distances from the camera to the nearest and the farthest known place
        between which bodies are; points for a camera lie around the motion, not at its bounds.
    Colours called by a name
        All by maximum likelihood of the visible pixels of 90 bodies of 14 colours in 30 rendered clips. saturation,
        hue: standard deviations of saturation times the hue's unit vector along and across it. duller: ratio of a
        solid's saturation to that of a patch on a screen. value, darker: standard deviation and mean of ln(brightness)
        of a body in a scene beside a patch on a screen: a diffuse solid shows all angles to the light. shades: part of
        the bodies called by a name that have the colour of one of its shades. dim: brightness added before saturation
        is taken; the hue of what is nearly black is noise. any_colour: part of a body's pixels of any colour,
        highlights and reflections. typical: bins of colour that a typical body occupies, as in
        `appearance.log_likelihood`.
    Where no known body is
        shadow, other: parts of the pixels in shadows, and of what is neither background nor known. own_bins,
        shadow_bins: bins over which noise, and shadows of any depth, spread a colour of the background. least_noise:
        levels by which rounding and compression change flat colours. darkest, brightest, soft: ratios of brightness of
        shadows and highlights, and standard deviation beyond them. farthest: squared deviations beyond which all are
        alike, so that no single pixel decides.
        dwelling, least_free: part of the frames in which a body covers a pixel from which on it may have become
        background, and frames without it that then show the background.
    Places in a frame
        step: ratio of neighbouring radii; a square's response falls by a tenth halfway between. smaller, nearer: of the
        radius on the floor, what may be seen of a body, and how much nearer to the camera one flies. square: side of a
        square with a disc's area. ring, goes_on: outer radius of the surroundings where the body must not go on, and
        the weight of what looks like it there. least_inside: part of a square that is in the image and not hidden.
        candidates: of a frame; the right one was among the ten best wherever it was among them at all. faintest: of a
        candidate. apart: of two candidates, just less than two bodies side by side. depth_doubt: factor of the distance
        that a radius leaves open, half a step. resting: ratio to the radius on the floor below which a body may be on
        it, a step. size_spread: standard deviation of ln(radius) on the floor, of steps and of a solid's sides; aloft:
        most that another radius costs, since most bodies are on the floor most of the time.
    Paths
        unseen: log likelihood ratio from which a body is seen. clearest: beyond which a place is no better. turn: cost
        of a change of velocity by one radius per frame: the places found are off by a part of that. drift: the same out
        of sight, for accelerations of 0.2 radii a frame, as of gravity on a hand's breadth at 24 frames a second.
        jump: of a step of one radius where no velocity is known. struck: most that a change of velocity costs, since
        bodies collide. appears: of appearing or vanishing. pointed: of a place that was pointed at, more than colours
        can outweigh; within `pointed_reach` of its middle. longest: frames out of sight after which the velocity says
        nothing of the place.
    Rounds
        rounds: of looking, by name, then by the colours found. shared: within which two bodies cannot be. learned:
        within which colours are learned. named: by how much less a name's colours weigh beside those. least_pixels: to
        learn from. half: log likelihood ratio at which a place is half sure. alone: of the sum of two radii, beyond
        which bodies do not touch.
    Bodies at rest in the background
        clusters: of its colours. lightness: weight beside chroma, which shading and texture vary less. inner, gap,
        outer: radii of the core and of the ring that surrounds it. rare: part of a ring below which a colour does not
        occur in it. within: part of the core that lies in the image: less of it is unlike its surroundings by chance,
        and what is known of a scene seldom lies cut off by the image's edge in all frames. places: of one body, and
        `clear`, the least log likelihood ratio of one. unlike: log ratio of a colour's parts of core and ring from
        which it is the body's. reach: that a body may cover around its middle.
    Outlines
        core, core_gain: within which a pixel is rather the body's, and by how much. fall: cost of one radius outside
        the expected outline, squared. farthest_edge: that a body may reach. piece: of the largest piece, from which
        another is the same body behind something. most_alike: bodies of one colour that sizes are to distinguish.
        unknown_size: ln of a ratio of sizes where none was seen. least_area: pixels from which a size is known.
        stays, elsewhere: radii within which a body rests, and from which on it is elsewhere. least_free_rows, compared:
        frames of either kind at least, and that are compared. smooth: radius of the filter. changed: levels below which
        a place looks the same with the body there and without it.
        nearly_down: part of the frames in which a body that flies is taken to be next to the floor.
    """

    nearer_than: float = 0.75
    farther_than: float = 1.15
    saturation: float = 0.15
    hue: float = 0.1
    duller: float = 0.85
    value: float = 0.4
    darker: float = 0.45
    shades: float = 0.4
    dim: float = 0.06
    any_colour: float = 0.02
    typical: float = 300.0
    shadow: float = 0.05
    other: float = 0.02
    own_bins: float = 8.0
    shadow_bins: float = 60.0
    least_noise: float = 3.0
    darkest: float = 0.3
    brightest: float = 1.15
    soft: float = 0.05
    farthest: float = 80.0
    dwelling: float = 0.25
    least_free: int = 3
    step: float = 1.25
    smaller: float = 0.8
    nearer: float = 2.2
    square: float = 1.77
    ring: float = 1.6
    goes_on: float = 0.8
    least_inside: float = 0.2
    candidates: int = 14
    faintest: float = 0.3
    apart: float = 0.7
    depth_doubt: float = 1.12
    resting: float = 1.25
    size_spread: float = 0.2
    aloft: float = 0.5
    unseen: float = 1.0
    clearest: float = 6.0
    turn: float = 0.15
    drift: float = 12.0
    jump: float = 0.05
    struck: float = 3.0
    appears: float = 0.5
    pointed: float = 30.0
    pointed_reach: float = 1.1
    longest: int = 30
    rounds: int = 3
    shared: float = 0.6
    learned: float = 0.9
    named: float = 2.0
    least_pixels: int = 30
    half: float = 1.0
    alone: float = 1.2
    clusters: int = 32
    lightness: float = 0.4
    inner: float = 0.85
    gap: float = 1.35
    outer: float = 2.6
    rare: float = 0.02
    within: float = 0.75
    places: int = 5
    clear: float = 2.2
    unlike: float = 0.3
    reach: float = 1.4
    core: float = 0.7
    core_gain: float = 1.0
    fall: float = 12.0
    farthest_edge: float = 1.9
    piece: float = 0.3
    most_alike: int = 5
    unknown_size: float = 0.5
    least_area: float = 12.0
    nearly_down: float = 0.25
    stays: float = 0.5
    elsewhere: float = 3.0
    least_free_rows: int = 3
    compared: int = 9
    smooth: float = 0.3
    changed: float = 2.5

    def __post_init__(self) -> None:
        require_positive(self)
        require_shares(self, SHARES)


SETTINGS = KnownSettings()
