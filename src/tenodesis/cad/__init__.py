"""Solid models of a planar instrument on its bench: parts, assembly, drawings, and files for printing and CAD.

Needs the extra ``[cad]`` (build123d, trimesh). Solids are the kernel's, in mm; everything else is in SI units::

    model = tn.cad.build("scaled-up", process="fdm")
    tn.cad.write(model, Path("out"))            # STEP, STL, glTF, drawings, pictures
    tn.cad.tip_inertia(model)                   # kg·m², for dynamics.tip_inertia
"""

from tenodesis.cad.assembly import (
    Inertia,
    Mass,
    Overlap,
    Placed,
    assembled,
    inertias,
    interference,
    masses,
    mesh_play,
    tendon_length,
    tip_inertia,
    tip_place,
)
from tenodesis.cad.body_parts import Hardware
from tenodesis.cad.checks import Agreement, Printable, agreement
from tenodesis.cad.drawing import Row, draw_part, rows, write_drawings
from tenodesis.cad.model import Model, build
from tenodesis.cad.pack import FILES, Checks, check, write
from tenodesis.cad.parts import Dimension, Part
from tenodesis.cad.picture import draw_assembly, draw_exploded
from tenodesis.cad.process import PROCESSES, Process

__all__ = [
    "FILES",
    "PROCESSES",
    "Agreement",
    "Checks",
    "Dimension",
    "Hardware",
    "Inertia",
    "Mass",
    "Model",
    "Overlap",
    "Part",
    "Placed",
    "Printable",
    "Process",
    "Row",
    "agreement",
    "assembled",
    "build",
    "check",
    "draw_assembly",
    "draw_exploded",
    "draw_part",
    "inertias",
    "interference",
    "masses",
    "mesh_play",
    "rows",
    "tendon_length",
    "tip_inertia",
    "tip_place",
    "write",
    "write_drawings",
]


def __dir__() -> list[str]:
    return sorted(__all__)
