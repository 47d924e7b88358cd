"""The numbers that the paper prints, each with its place there; the report compares its results with them.

Paper: "Design Concept of Hybrid Instrument for Laparoscopic Surgery and Its Verification Using Scale Model Test".
"""

from tenodesis.report.content import Published

SCALE_FACTORS = {
    "stem_diameter": Published(3.75, "Table I"),
    "overall_length": Published(2.0, "Table I"),
    "distal_gear_radius": Published(3.75, "Table I"),
    "proximal_gear_radius": Published(3.75, "Table I"),
    "end_effector_length": Published(1.72, "Table I"),
    "handle_length": Published(1.33, "Table I"),
    "tendon_diameter": Published(0.857, "Table I"),
    "tendon_modulus": Published(1.0, "Table I"),
    "tendon_stiffness": Published(0.367, "Table I"),
    "force": Published(2.88, "Table II"),
    "tension": Published(1.377, "Table II"),
    "loss_of_dexterity": Published(1.0, "Table II"),
}

STIFFNESS = {"real-size": Published(31172.0, "Table I"), "scaled-up": Published(11451.0, "Table I")}
"""N/m, by instrument."""

EQUIVALENT_FORCE = Published(0.52, "Section VII-B")
"""Force on the real-size instrument, N, that corresponds to 1.5 N on the scaled-up instrument."""

CAPTION_FORCE = Published(1.5, "caption of Fig. 15")
"""Force on the real-size instrument, N, that the caption equates with the cable's 10 N."""

TIP_FORCE = Published(1.5, "Section VII-B")
"""Force at the scaled-up tip, N, equivalent to 0.15 N·m."""

ESTIMATION_ERRORS = {
    0.5: Published(2.18, "Section VII-A, Fig. 14"),
    1.0: Published(2.38, "Section VII-A, Fig. 14"),
    1.5: Published(2.97, "Section VII-A, Fig. 14"),
}
"""Root mean square error of eq. 19's estimate, deg, by tangential force, N."""

STATES = (
    (Published(0.0, "Fig. 15(a)"), Published(0.0, "Fig. 15(a)")),
    (Published(10.0, "Fig. 15(b)"), Published(33.0, "Fig. 15(b)")),
    (Published(20.0, "Fig. 15(c)"), Published(67.0, "Fig. 15(c)")),
    (Published(26.0, "Fig. 15(d)"), Published(80.0, "Fig. 15(d)")),
)
"""Handle and output angle, deg, of the four states held in Fig. 15."""
