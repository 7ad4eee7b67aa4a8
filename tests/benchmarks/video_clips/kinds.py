"""List the kinds of scene by name."""

from collections.abc import Callable

from numpy.random import Generator

from .bodies import Scene
from .draw_flight import bouncing, ramp, tossed
from .draw_floor import billiard, entering, floor
from .draw_hung import cart, cloth, pendulum, rope
from .looks import Look

KINDS: dict[str, Callable[[Generator, Look], Scene]] = {
    "floor": floor,
    "billiard": billiard,
    "tossed": tossed,
    "bouncing": bouncing,
    "ramp": ramp,
    "pendulum": pendulum,
    "cart": cart,
    "entering": entering,
    "rope": rope,
    "cloth": cloth,
}
