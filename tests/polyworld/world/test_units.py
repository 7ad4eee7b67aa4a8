"""Units and numbers written with them."""

from __future__ import annotations

import math

import pytest

from polyworld.world.units import find_unit, read_quantity


@pytest.mark.parametrize(
    ("text", "dimension", "factor"),
    [
        ("mm", "length", 1e-3),
        ("Metres", "length", 1.0),
        ("µm", "length", 1e-6),
        ("in", "length", 0.0254),
        ("ms", "time", 1e-3),
        ("°", "angle", math.pi / 180),
        ("rpm", "angular velocity", 2 * math.pi / 60),
        ("deg/s", "angular velocity", math.pi / 180),
        ("rad s^-1", "angular velocity", 1.0),
        ("rad·s⁻¹", "angular velocity", 1.0),
        ("rev_per_s", "angular velocity", 2 * math.pi),
        ("deg_s", "angular velocity", math.pi / 180),
        ("cm/s", "velocity", 0.01),
        ("g", "mass", 1e-3),
        ("px", "pixels", 1.0),
    ],
)
def test_units_are_known_by_their_usual_names(text: str, dimension: str, factor: float) -> None:
    unit = find_unit(text)
    assert unit is not None
    assert unit.dimension == dimension
    assert unit.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize("text", ["", "raw", "m/kg", "m/s^2", "1", "s/m"])
def test_what_is_no_unit_is_not_taken_for_one(text: str) -> None:
    assert find_unit(text) is None


def test_quantities_are_read_in_si() -> None:
    assert read_quantity("40mm", "length") == pytest.approx(0.04)
    assert read_quantity(" 2.5e1 cm ", "length") == pytest.approx(0.25)
    assert read_quantity("0.02", "length") == 0.02
    assert read_quantity("180deg", "angle") == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("40g", "'g' is no unit of length; choose from m, cm, mm"),
        ("big", "'big' is not a number"),
        ("", "not a number"),
    ],
)
def test_a_quantity_of_another_kind_is_refused_with_the_choices(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_quantity(text, "length")
