"""Compare the acceleration of free flight with gravity: wrong units of length or time, swapped or flipped axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding, Severity
from polyworld.screening.free_fall import Fall
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.time_stamps import counts_frames, usual_rate
from polyworld.screening.tracks import Track
from polyworld.world import World

Array = NDArray[np.float64]

LENGTHS = {"mm": 1000.0, "cm": 100.0, "in": 39.3701, "ft": 3.28084, "km": 1e-3}  # units in a metre
NAMES = {"m": "metres", "mm": "millimetres", "cm": "centimetres", "in": "inches", "ft": "feet", "km": "kilometres"}
RATE_LIMITS = (15.0, 2000.0)  # [1/s] frame rates that gravity may give times that count frames
# What to write for x, y, z where "up" is an axis of the data; right-handed axes stay so.
RELABELLED = {
    (0, 1): "x = y, y = z, z = x",
    (0, -1): "x = z, z = -x",
    (1, 1): "y = -z, z = y",
    (1, -1): "y = z, z = -y",
    (2, -1): "y = -y, z = -z",
}


def fall_findings(world: World, tracks: Sequence[Track], fall: Fall, settings: ScreenSettings) -> list[Finding]:
    """Return what the acceleration of free flight says about units of length and time, and about axes."""
    gravity = np.asarray(world.environment.gravity, dtype=float)
    size = float(np.linalg.norm(fall.acceleration))
    ratio = size / float(np.linalg.norm(gravity))
    cosine = float(fall.acceleration @ gravity) / size / float(np.linalg.norm(gravity))
    along = int(np.argmax(np.abs(fall.acceleration)))
    on_axis = abs(float(fall.acceleration[along])) >= settings.oblique * size
    wrong_way = on_axis and cosine < 1.0 - settings.oblique
    if cosine < 0.5 and not wrong_way:
        return []
    units = _units(tracks, fall, ratio, settings)
    if not wrong_way:
        return units
    factor = next((f.figures["factor"] for f in units if "factor" in f.figures), 1.0)
    off = abs(float(np.log(ratio / factor)))
    # Any other acceleration in a direction of its own is friction, a slope or buoyancy.
    if off > settings.unit_tolerance + 3.0 * fall.error:
        return []
    return units + _axes(fall, gravity, along, off <= settings.close_match + 3.0 * fall.error, settings)


def _units(tracks: Sequence[Track], fall: Fall, ratio: float, settings: ScreenSettings) -> list[Finding]:
    """Return what the ratio of the acceleration to gravity says about units, or about times that count frames."""
    if 1.0 / settings.unlike < ratio < settings.unlike:
        return []
    figures = {"ratio": ratio, "relative_error": fall.error, "agreeing": fall.share}
    sure = fall.share >= settings.refusing
    times = f"{ratio:.0f}" if ratio >= 100.0 else f"{ratio:.3g}"
    falls = f"In free flight the acceleration is {times} times gravity"
    if counts_frames(tracks, settings):
        rate = float(ratio**-0.5)
        if not RATE_LIMITS[0] <= rate <= RATE_LIMITS[1]:
            return []
        usual = usual_rate(rate, settings.unit_tolerance / 2.0)  # rates go with the root of accelerations
        near = f" ({usual:g} is usual)" if usual is not None and f"{rate:.3g}" != f"{usual:g}" else ""
        sentence = (
            f"{falls} and times are 0, 1, 2, ..., so that they seem to count frames, about {rate:.3g} a second{near}: "
            f"call their column frame and give --fps {usual or rate:.3g}, or state --units s if a second really passes "
            "between samples."
        )
        severity: Severity = "refuse" if sure else "caution"
        return [Finding("frame_numbers", severity, sentence, fall.runs, figures | {"rate": rate})]
    slow = float(np.median([t.interval for t in tracks])) > settings.slow
    choices = [(name, "s", factor) for name, factor in LENGTHS.items() if not (slow and name == "km")]
    if slow:
        choices += [("m", "ms", 1e-6), *((name, "ms", 1e-6 * factor) for name, _, factor in choices)]
    unit, clock, factor = min(choices, key=lambda c: abs(np.log(ratio / c[2])))
    off = abs(float(np.log(ratio / factor)))
    # Drag and lift change an acceleration by tens of percent, so that units are not met exactly.
    if off > settings.unit_tolerance + 3.0 * fall.error:
        sentence = (
            f"{falls}, which is the factor of no common unit of length: if positions are in pixels give their "
            "scale with --pixels-per-metre, and check the gravity of the world."
        )
        return [] if ratio < 1.0 else [Finding("units", "caution", sentence, fall.runs, figures)]
    close = off <= settings.close_match + 3.0 * fall.error
    far = not 1.0 / settings.no_effect < factor < settings.no_effect
    sure = unit != "km" and ((sure and (close or far)) or (close and far))
    wrong = {unit: f"positions seem to be in {NAMES[unit]}", clock: "times seem to be in milliseconds"}
    stated = [name for name in (unit, clock) if name not in ("m", "s")]
    sentence = (
        f"{falls}, so that {' and '.join(wrong[name] for name in stated)}: state --units {','.join(stated)}, or "
        "--units m,s if they are in metres and seconds."
    )
    return [Finding("units", "refuse" if sure else "caution", sentence, fall.runs, figures | {"factor": factor})]


def _axes(fall: Fall, gravity: Array, along: int, close: bool, settings: ScreenSettings) -> list[Finding]:
    """Return what the data's vertical axis seems to be, where it is not the world's."""
    upward = -1 if fall.acceleration[along] > 0.0 else 1
    down = np.zeros(3)
    down[along] = -upward * np.linalg.norm(gravity)
    usual = gravity[2] < 0.0 and not np.any(gravity[:2])
    main = int(np.argmax(np.abs(gravity)))
    vector = ", ".join(f"{v:g}" for v in down + 0.0)
    cure = f"give the world the gravity ({vector})"
    if usual:
        cure = f"write {RELABELLED[along, upward]} for the columns, so that z is up, or {cure}"
    unmeasured = "" if main in fall.measured else ", which was not measured"
    sentence = (
        f"In free flight bodies accelerate along {'+-'[upward > 0]}{'xyz'[along]} and not along the world's gravity, "
        f"{'+-'[int(gravity[main] < 0.0)]}{'xyz'[main]}{unmeasured}, so that axes of the data seem to be "
        f"{'flipped' if down @ gravity < 0.0 else 'swapped'}: {cure}."
    )
    severity: Severity = "refuse" if close and fall.share >= settings.refusing else "caution"
    figures = {f"acceleration_{'xyz'[a]}": float(fall.acceleration[a]) for a in fall.measured}
    return [Finding("axes", severity, sentence, fall.runs, figures | {"agreeing": fall.share})]
