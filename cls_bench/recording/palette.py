"""Colours by meaning, as in the reports: Okabe and Ito's, which colour-blind people can tell apart."""

Color = tuple[int, int, int]

PILOT: Color = (230, 159, 0)
MEASURED: Color = (86, 180, 233)
MODEL: Color = (255, 138, 76)
MOTOR: Color = (47, 199, 157)
STAGE1: Color = (204, 121, 167)
STAGE2: Color = (240, 228, 66)
STAGE3: Color = (0, 114, 178)
QUIET: Color = (140, 148, 156)

STAGES = (STAGE1, STAGE2, STAGE3)
"""Of the gearbox, the motor's first."""


def hexadecimal(color: Color) -> str:
    """``#e69f00``."""
    return "#{:02x}{:02x}{:02x}".format(*color)
