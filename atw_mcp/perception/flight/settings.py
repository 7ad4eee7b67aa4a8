"""Settings: how bodies are expected to move between contacts, and how well masks locate them."""

from __future__ import annotations

from dataclasses import dataclass, field

from atw_mcp.perception.flight.sightings import SightingSettings


@dataclass(frozen=True)
class FlightSettings:
    """Expectations as standard deviations, and prices of explanations in nats.

    length: of places about the middle of what is seen, of the width of the view there.
    speed: of bodies, of the one at which they fall through that length times the square root of two.
    friction: acceleration on a surface beside gravity's pull along it, of g.
    covered: price of a frame in which something fixed would hide the body, were it on the floor.
    contact: price of a contact, one frame in twenty having one.
    leave: price of another motion than the usual one, on the floor, which most videos show alone.
    unexplained: price of a frame that no motion explains, about four standard deviations.
    sink: depth below the floor that is still taken for an error, of the distance.
    least: frames that show a flight at least.
    tails: degrees of freedom of the sightings' noise, of Student's distribution.
    alike: frames in a row whose masks err together, which count as one.
    odd: price of a contact at which a body neither lands, rebounds nor rolls off, as when another one hits it.
    parted: price at most of a gap between stretches that follow each other.
    touch: height above the floor of a body that bounces, of its size, as seen between two frames.
    joint [m]: distance of two motions where they meet, as a contact takes some time.
    kept, kept_spread: share of the tangential velocity that is left after a rebound, and its deviation.
    rubbing: deviation of the tangential velocity after a rebound, from friction and spin, of the normal one.
    restitution, restitution_spread: of the normal velocity, what is left after a rebound, and its deviation.
    gain [m/s]: error of a speed, by which a body may seem faster after a contact.
    struck: price at most of being faster, as of a body that another one hits.
    most: sightings that are divided at first, of a longer film evenly chosen ones.
    trusted: factor of the standard deviations of places, which are from one explanation among many.
    unsure: standard deviation of a flight's places, of the body's radius, above which they are not used.
    low: height of bounces that do not show, of the height of rest.
    quietest: variance of sightings, of the expected one, below which they are not believed to be, since what is left
        of a mask's error is alike in all frames.
    lying: upward part of a cylinder's axis below which it lies on its side.
    rounds: of reweighting and of velocities at contacts where stretches are solved together.
    cut: sightings of a piece that is cut off.
    shifts: frames by which a contact is tried earlier or later.
    worth: nats that a change of the division has to gain.
    changes: of a division at the most: a film of some contacts is settled after ten.
    """

    length: float = 1.0
    speed: float = 1.0
    friction: float = 0.3
    covered: float = 4.0
    contact: float = 3.0
    leave: float = 10.0
    unexplained: float = 8.0
    sink: float = 0.03
    least: int = 4
    tails: float = 4.0
    alike: float = 2.0
    odd: float = 4.0
    parted: float = 8.0
    touch: float = 0.2
    joint: float = 0.01
    kept: float = 0.85
    kept_spread: float = 0.15
    rubbing: float = 0.2
    restitution: float = 0.55
    restitution_spread: float = 0.3
    gain: float = 0.3
    struck: float = 8.0
    most: int = 100
    trusted: float = 2.0
    unsure: float = 2.0
    low: float = 0.3
    quietest: float = 0.05
    lying: float = 0.7
    rounds: int = 4
    cut: int = 3
    shifts: tuple[int, ...] = (-3, -2, -1, 1, 2, 3)
    worth: float = 0.1
    changes: int = 30
    sightings: SightingSettings = field(default_factory=SightingSettings)
