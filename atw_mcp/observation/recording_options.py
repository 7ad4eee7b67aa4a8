"""Tables of measured motion, read as command-line options say."""

from __future__ import annotations

import argparse
import ast
import sys
import warnings
from pathlib import Path

from polyworld.data.pixel_scale import PixelScale
from polyworld.data.recording import Recording
from polyworld.data.recording_columns import Units
from polyworld.data.recording_csv import read_recording
from polyworld.data.recording_header import RecordingForm
from polyworld.world import World
from polyworld.world.units import read_quantity


def recording_form(options: argparse.Namespace) -> RecordingForm:
    """Return the form of the table; raises ValueError that names the option and what it takes."""
    try:
        Units.of(options.units)
    except ValueError as error:
        raise ValueError(f"--units: {str(error).partition(': ')[2]}") from error
    try:
        columns = ast.literal_eval(options.columns)
    except (ValueError, SyntaxError):
        columns = None
    if not isinstance(columns, dict) or not all(isinstance(text, str) for pair in columns.items() for text in pair):
        raise ValueError(f"--columns takes headers and what they mean, as {{'Y': 'z [mm]'}}, got {options.columns!r}")
    seconds = options.seconds_per_frame
    if options.fps is not None:
        seconds = 1.0 / options.fps if options.fps > 0.0 else -1.0
    if seconds is not None and not 0.0 < seconds < float("inf"):
        raise ValueError("--fps and --seconds-per-frame take a positive number")
    return RecordingForm(
        columns=columns,
        units=options.units,
        seconds_per_frame=seconds,
        pixels=_pixels(options),
        theta_described=_angle("--theta-described", options.theta_described) or 0.0,
        theta_hanging=_angle("--theta-hanging", options.theta_hanging),
    )


def read_with_remarks(path: Path, form: RecordingForm, world: World) -> Recording:
    """Return the recording in a file; remarks of the reader go to stderr, each once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recording = read_recording(path, world.moving_names, form=form, world=world)
    for remark in dict.fromkeys(str(w.message) for w in caught):
        print(f"{path.name}: {remark}", file=sys.stderr)
    return recording


def _pixels(options: argparse.Namespace) -> PixelScale | None:
    others = [o for o in ("origin_pixel", "image_axes", "view") if getattr(options, o) is not None]
    if options.pixels_per_metre is None:
        if others:
            named = ", ".join(f"--{o.replace('_', '-')}" for o in others)
            raise ValueError(f"{named} go with --pixels-per-metre, the scale of the pixels")
        return None
    text = options.origin_pixel or "0,0"
    try:
        u, v = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--origin-pixel takes two numbers U,V such as 320,240, got {text!r}") from None
    try:
        return PixelScale(options.pixels_per_metre, (u, v), bool(options.image_axes), options.view or "side")
    except ValueError as error:
        raise ValueError(f"--pixels-per-metre: {error}") from error


def _angle(option: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        return read_quantity(text, "angle")
    except ValueError as error:
        raise ValueError(f"{option}: {error}") from error
