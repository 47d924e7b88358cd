"""Solid models of a planar instrument on its bench: parts, assembly, drawings, and files for printing and CAD.

Needs the extra ``[cad]`` (build123d, trimesh). Solids are the kernel's, in mm; everything else is in SI units::

    model = tn.cad.build("scaled-up", process="sla")
    tn.cad.write(model, Path("out"))            # STEP, STL, glTF, drawings, pictures
    tn.cad.with_inertia(model)                  # the instrument, whose twin has the solids' inertia
"""

from tenodesis.cad.assembly import Overlap, Placed, assembled, interference, mesh_play
from tenodesis.cad.bench_parts import Hardware
from tenodesis.cad.checks import Agreement, Printable, agreement, tendon_lengths, tip_places
from tenodesis.cad.drawing import Row, draw_part, rows, write_drawings
from tenodesis.cad.masses import Inertia, Mass, inertias, masses, tip_inertia, with_inertia
from tenodesis.cad.model import Model, build
from tenodesis.cad.pack import ASSEMBLY, FILES, FOLDERS, Checks, check, gltf, urdf, write
from tenodesis.cad.parts import PROCESSES, Dimension, Part, Process
from tenodesis.cad.picture import draw_assembly, draw_exploded

__all__ = [
    "ASSEMBLY",
    "FILES",
    "FOLDERS",
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
    "gltf",
    "inertias",
    "interference",
    "masses",
    "mesh_play",
    "rows",
    "tendon_lengths",
    "tip_inertia",
    "tip_places",
    "urdf",
    "with_inertia",
    "write",
    "write_drawings",
]


def __dir__() -> list[str]:
    return sorted(__all__)
