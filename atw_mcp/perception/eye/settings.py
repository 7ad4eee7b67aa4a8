"""Every tuned number of the eye, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EyeSettings:
    """Numbers of the pixel likelihood, the pose search and the follower.

    Log-likelihoods are in nats, features are logarithms of levels (pixels.features), lengths in pixels or in radii of a
    body (the radius of the circle of its area).
    """

    # features and likelihoods of a pixel
    dark_level: float = 12.0  # [levels] added before the logarithm: noise of coding below it would dominate
    unknown: float = 4e-4  # density of a pixel that nothing explains: uniform over the range of the three features
    decided: float = 5.0  # [nats] a pixel's log odds are limited to this: one pixel never decides alone
    clusters: int = 6  # colours of a body: a shaded body of one paint needs 3, a mirror ball 6
    cells: int = 7  # by place on the body, along each axis
    cell_blur: float = 1.0  # [cells] smoothness of the colours' weights over the body
    place_prior: float = 20.0  # [pixels] weight of the whole body's colours in a cell
    least_spread: tuple[float, float, float] = (0.06, 0.03, 0.03)  # of a colour: coding noise and aliased edges
    least_pixels: int = 8  # of a body below which colours are not learned
    sampled_pixels: int = 4000  # of a body from which colours are learned; more change nothing

    # background and shade
    background_frames: int = 30  # sampled over the clip for the background; its median is then good to 20% of noise
    rare: float = 2.0  # [nats] by which a pixel looks like a body rather than like the film
    noise_floor: float = 0.012  # [feature] least noise of the background: rounding of levels of 100
    sharp: float = 0.25  # [px] by which edges of the background may be displaced: coding, shake
    free_shade: float = 0.12  # probability of a darkening that the shade around the body does not predict
    deepest_shade: float = 2.6  # [log] darkening by shadow at the most, a factor of 13
    brightest_light: float = 0.25  # [log] brightening by reflected light at the most
    shade_slack: float = 0.2  # share of a predicted darkening by which it may be wrong
    shade_chroma: float = 0.05  # chroma error per unit of darkening: the added dark level bends it
    shade_reach: float = 4.0  # [radii] around a body over which its shade is learned
    shade_cells: int = 40  # along each axis of that
    shade_blur: float = 0.6  # [cells] smoothness
    edge_band: float = 1.5  # [px] along a silhouette from which neither body nor background is learned: mixed pixels

    # silhouettes
    normals: int = 80  # along a contour at the most: neighbours nearer than a pixel say the same
    step: float = 0.5  # [px] along a normal: half the width of an edge
    # [px] of a normal, coarse to fine; the last steps, 0, resolve edges by mixed pixels
    reaches: tuple[float, ...] = (12.0, 8.0, 5.0, 4.0, 4.0, 0.0, 0.0)
    reach_radii: float = 0.7  # [radii] of a normal at the most: beyond it lies another side of the body
    edge_error: float = 0.3  # [px] standard deviation of one normal's edge at the best
    mixed_near: float = 2.0  # [px] from an edge within which pixels are mixed: lens, coding of colour at half size
    shaded_edge: float = 2.0  # [px] per unit of log factor: an edge against a shade may be the shade's own
    pure_error: float = 0.7  # [px] of an edge by pure colours: mixed pixels count for the more varied side
    light_noise: float = 0.01  # of a pixel's light, of 1: about three levels
    robust: float = 2.0  # scales of residuals of normals beyond which they lose weight
    outward: float = 0.45  # of that, for edges farther out: what shades or mirrors a body adds to it, and nothing takes
    border: float = 0.5  # [px] by which all edges of a solid may lie farther out: lens, a size that is not quite right
    rims: float = 0.1  # of a radius, to which the rims of cylinders may be rounded; boxes are sharper
    correlated: float = 2.5  # [px] along a contour over which errors of normals are alike
    systematic: float = 0.02  # of a radius: error of a pose that no curvature shows (colours, shape)

    # following
    weak: float = 0.65  # of its usual contrast, or share of decided edges, below which a place is doubted: it is also
    # searched for elsewhere, and the confidence falls
    apart: float = 0.7  # [radii] below which two bodies' places are one, which only one of them can take
    search: float = 5.0  # [radii] around the prediction in which a body is searched for; five times it after misses
    coarse: float = 4.0  # [px] radius of a body at the resolution of that search
    peaks: int = 3  # of the search that are refined
    present: float = 0.5  # [nats] contrast of mean log odds, inside over around, from which on a body is seen
    fraction: float = 0.35  # of its usual contrast below which a body is not seen
    support: float = 10.0  # independent pixels that a body counts for at the most: errors of its model are alike
    visible: float = 0.08  # share of a body's area from which on it is seen
    jump: float = 2.0  # [radii] between frames beyond the motion around: a break
    faster: float = 1.5  # times the motion around that is no jump, and is searched: a throw, a blow
    gap: int = 4  # [frames] over which motion can be continued: without sight, before and after a meeting
    motion: float = 0.5  # [radii] standard deviation of a frame's change of displacement; a fifth at the least
    rounds: int = 2  # of states, then colours, at the most
    hold: float = 0.3  # [radii] standard deviation of a seed: a centre given by eye
    hold_pixels: float = 2.0  # [px] at least: what is drawn by eye is no better
    turn: float = 0.15  # [rad] standard deviation of a frame's change of angle
    growth: float = 0.02  # [log] standard deviation of an outline's scale from that of its seed

    # masks
    smooth: float = 1.2  # [nats] price of a pair of neighbours of different states

    # discovery
    discovery_pixels: float = 130_000.0  # of a frame at the most: smaller bodies than 4 px of 1080p are not proposed
    differs: float = 5.0  # [standard deviations] from the background of a pixel that is not
    least_region: int = 12  # [px] of a region: smaller ones are noise of coding
    persistence: float = 0.25  # correlation of displacements of following frames: 1 of smooth motion, -0.5 of noise
    link: float = 2.0  # of unlikeness from frame to frame, to which distance, size and colour add about 1 each
    growing: float = 0.25  # [log] change of area of what is no rigid body; twice it in a frame: a merger
    hollow: float = 0.75  # share of its convex hull below which a region is no one rigid body
    shadow_reach: float = 10.0  # [radii] from a body to its shadow: low light, a high throw
    surroundings: float = 0.4  # of the picture's smaller side, over which a body at rest is rare: twice its diameter
    largest_standing: float = 0.05  # of the picture: what is larger is taken for ground or furniture
    like_size: float = 5.0  # times larger or smaller than all that moves: a mark or furniture, if at rest
    sharp_edge: float = 0.15  # [feature] across the outline of a body at rest: pools of light and vignettes are softer
    pattern: int = 6  # like regions at rest: more are tiles of the ground

    # finding of known solids
    named: float = 0.3  # probability of a colour's name from which on pixels are searched for it: of twelve names
    named_frames: int = 8  # in which they are
    plane_size: float = 0.3  # [log area] of an outline about the silhouette on the plane: shade, unknown angle
    unlikely: float = 3.0  # [nats] of odds below which a region is no body, and none called by a colour's name: 1 of 20
    likely: float = 1.0  # [nats] below the likeliest region of a body, from which a longer one says where it moves
    at_rest: float = 0.3  # odds that what has a body's colour but is not seen to move is one
    misfit: float = 0.1  # of a silhouette's area, by which it differs from an outline: shade, rounded edges
    free_depth: float = 0.7  # [log distance] of a body anywhere in view
    sought: int = 8  # places of a silhouette in a frame: other bodies take some
    contrast: float = 0.4  # [feature] mean step across an edge of a body, of an exponential distribution
    edge_odds: float = 1.5  # [nats] of an edge of a silhouette at the most: none decides alone
    overlap: float = 0.6  # of outline and silhouette on the plane, over both: less is another shape

    # assignment
    meeting: float = 1.2  # [sums of radii] between look-alikes below which they may be exchanged
    orders: int = 48  # best assignments kept from one meeting to the next
