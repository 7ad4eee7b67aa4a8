"""Independent benchmark generator: tracks of balls and discs in which an unmentioned law acts (SI units, z up)."""
