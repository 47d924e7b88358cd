"""The choices of the controller in plain words."""

LAWS = {
    "off": "Off: the motors stand still; what the load takes is lost.",
    "paper": "The paper's law (eq. 22) as a set point: winds by half the difference of the tensions.",
    "paper-feedback": "The paper's law in feedback: the difference of the tensions winds the spools on and on.",
    "exact": "The whole stroke that theory without friction asks for, slack included.",
    "robust": "Learns the friction from small strokes, and gives the angle back through it.",
}
"""Compensation laws."""

ACTUATIONS = {
    "agonist": "One motor winds the agonist tendon.",
    "differential": "Both motors work: one winds what the other lets out.",
}
"""Actuation modes."""
