"""Independent benchmark generator: short rendered clips of moving bodies with their true motion (SI units, z up)."""
