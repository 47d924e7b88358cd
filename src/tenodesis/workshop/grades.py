"""Grades of tolerances, and what they cost.

Costs are relative: 1 is one part turned to general tolerances. All costs are ours: from IT8 on they double about every
two grades; replace them by your workshop's.
"""

from math import hypot, inf, radians
from typing import NamedTuple

from tenodesis.instrument import Instrument
from tenodesis.tolerance.defaults import general_tolerance

# ISO 286-1, standard tolerances in um by grade, of the diameters up to each of the sizes, mm.
_SIZES = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
_IT = {
    5: (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27),
    6: (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40),
    7: (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63),
    8: (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97),
    9: (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155),
    10: (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250),
    11: (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400),
}
_IT_COST = {11: 0.4, 10: 0.6, 9: 0.9, 8: 1.3, 7: 1.9, 6: 3.0, 5: 5.0}
# DIN 3967, um by reference diameters up to each of the sizes, mm: allowance and tolerance of a tooth's thickness.
_GEAR_SIZES = (10, 50, 125, 280)
_TEETH = {"cd25": ((40, 54, 70, 95), (20, 30, 40, 50), 0.0), "e24": ((22, 30, 40, 56), (12, 20, 25, 30), 0.8)}
_FITTED, _TURNED_PLATES = (0.02e-3, 1.0), (0.004e-3, 1.5)  # m of play, and the cost
_DIN_3967 = "DIN 3967, largest play of two gears alike, quoted from memory of its tables; cost ours"
_GENERAL_COST = {"c": 0.0, "m": 0.1, "f": 0.3}
_SET_LENGTH = (0.02e-3, 1.0)  # m, and its cost
_TRIMMED = radians(0.05)
_ISO_286 = "ISO 286-1, quoted from memory of its table; cost ours"
_ISO_2768 = "ISO 2768-1; cost ours"


class Grade(NamedTuple):
    """A grade: its name, how far off a value may be (SI units), and its cost per piece."""

    name: str
    width: float
    """Half width of a uniform distribution, or the standard deviation of a normal one."""
    cost: float
    source: str
    is_normal: bool = False


def standard_tolerance(diameter: float, grade: int) -> float:
    """Return the standard tolerance (m) of a diameter (m, up to 500 mm) by ISO 286-1, grades IT5 to IT11."""
    column = next(n for n, size in enumerate(_SIZES) if 1e3 * diameter <= size * (1 + 1e-9))
    return 1e-6 * _IT[grade][column]


def of_radius(radius: float) -> tuple[Grade, ...]:
    """Return the grades of a radius (m) to the rope's centre, toleranced on the drawing as a diameter."""
    diameter = 2 * radius
    found = [
        Grade(f"ISO 2768-{one}", 1e-3 * general_tolerance(diameter, one) / 2, cost, _ISO_2768)
        for one, cost in _GENERAL_COST.items()
    ]
    if 1e3 * diameter <= _SIZES[-1]:
        found += [
            Grade(f"IT{grade}", standard_tolerance(diameter, grade) / 4, cost, _ISO_286)
            for grade, cost in _IT_COST.items()
        ]
    return _worthwhile(found)


def of_length(length: float) -> tuple[Grade, ...]:
    """Return the grades of a length (m)."""
    found = [
        Grade(f"ISO 2768-{one}", 1e-3 * general_tolerance(length, one), cost, _ISO_2768)
        for one, cost in _GENERAL_COST.items()
    ]
    width, cost = _SET_LENGTH
    return _worthwhile([*found, Grade("set by a height gauge", width, cost, "ours: an adjustable stop")])


def of_backlash(radius: float, made: float | None) -> tuple[Grade, ...]:
    """Return the grades of the play of two gears alike (pitch radius, m) along the pitch circle, half of it each way.

    `made` is the play (m) of gears that are printed or milled with the part; without it, gears are cut and bought.
    """
    if made is not None:
        found = [Grade(f"as made, play {1e3 * made:.3g} mm", made / 2, 0.0, "play that the process needs, ours")]
    else:
        column = next((n for n, size in enumerate(_GEAR_SIZES) if 2e3 * radius <= size), len(_GEAR_SIZES) - 1)
        found = [
            Grade(f"DIN 3967 {name}", 1e-6 * (allowance[column] + width[column]), cost, _DIN_3967)
            for name, (allowance, width, cost) in _TEETH.items()
        ]
    for name, (play, cost), source in (
        ("links bored to the gears' play", _FITTED, "ours: centre distance set until 0.02 mm of play are left"),
        ("plates turned apart", _TURNED_PLATES, "ours: of a half's two toothed plates one is turned and then fixed"),
    ):
        found.append(Grade(name, play / 2, cost, source))
    return _worthwhile(found)


def of_stiffness(nominal: float, turn: float) -> tuple[Grade, ...]:
    """Return the grades of a tendon's stiffness or modulus; `turn` is how far the tip turns (rad) per share of it.

    What is left after a measurement is its uncertainty, since pretension and weights are set for the measured value.
    """
    grades = [
        _share("rope as bought", nominal, 0.05, 0.0, "ours: spread of catalogue moduli, a bedded-in rope"),
        _share("pull test of one rope", nominal, 0.02, 1.0, "ours: load cell and dial gauge"),
        _share(
            "pull test of every tendon", nominal, 0.01, 2.0, "ours: with its terminations, load cell and dial gauge"
        ),
    ]
    trimmed = _TRIMMED / turn if turn > 0 else inf
    if trimmed < 0.01:
        source = "ours: the tip's encoder reads the loss under the largest weight to 0.05 deg, mean of both directions"
        grades.append(_share("weights trimmed on the loaded tip", nominal, trimmed, 4.0, source))
    return _worthwhile(grades)


def of_pretension(inst: Instrument, nominal: float) -> tuple[Grade, ...]:
    """Return the grades of a pretension, N, of an instrument with its load cells and sheaths."""
    sensors = inst.sensors
    step = sensors.load_cell_range / 2**sensors.load_cell_bits
    in_sheath = 0.2 * inst.friction.sheath_coefficient * inst.friction.sheath_bend
    as_sold = hypot(sensors.load_cell_gain_error, sensors.load_cell_offset / nominal, in_sheath)
    calibrated = hypot(0.001, step / nominal, in_sheath / 5)
    return _worthwhile(
        [
            _share("spring balance", nominal, 0.05, 0.0, "ours"),
            _share(
                "load cells, tared", nominal, as_sold, 0.5,
                "the file's gain error and offset; a fifth of the sheath's friction",
            ),
            _share(
                "load cells calibrated by weights", nominal, calibrated, 1.5,
                "ours: 0.1 %, a step of the cell, tendons worked to and fro so that the sheath's friction cancels",
            ),
        ]
    )  # fmt: skip


def of_backbone(nominal: float) -> tuple[Grade, ...]:
    """Return the grades of a backbone's flexural rigidity."""
    return (
        _share("wire as bought", nominal, 0.04, 0.0, "ours: 1 % of its diameter, to the fourth power"),
        _share("bending test", nominal, 0.01, 1.0, "ours"),
    )


def of_spring(nominal: float) -> tuple[Grade, ...]:
    """Return the grades of the stiffness of a spring in a joint."""
    return (
        _share("spring as made", nominal, 0.05, 0.0, "ours: 1 % of its wire, to the fourth power, and its coils"),
        _share("spring measured", nominal, 0.01, 1.0, "ours: a weight on a lever"),
    )


def _share(name: str, nominal: float, share: float, cost: float, source: str) -> Grade:
    return Grade(name, nominal * share, cost, source, is_normal=True)


def _worthwhile(grades: list[Grade]) -> tuple[Grade, ...]:
    """Return the grades, cheapest first, without those that a cheaper one is as fine as."""
    kept: list[Grade] = []
    for one in sorted(grades, key=lambda grade: (grade.cost, grade.width)):
        if not kept or one.width < kept[-1].width * (1 - 1e-9):
            kept.append(one)
    return tuple(kept)
