"""The pack of an instrument's solids: STEP, STL, glTF, URDF, drawings, pictures, and what was checked."""

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, TreeBuilder, XMLParser, fromstring, indent, tostring

import numpy as np

from tenodesis import files, kinematics
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import Overlap, Progress, assembled, frames_of, interference, matrix, mesh_play, ranges
from tenodesis.cad.checks import Agreement, Printable, agreement, printable, write_mesh
from tenodesis.cad.drawing import write_drawings
from tenodesis.cad.gears import GearJoint
from tenodesis.cad.masses import Inertia, inertias, masses, tip_inertia, with_inertia
from tenodesis.cad.model import Model
from tenodesis.cad.picture import colours_of, draw_assembly, draw_exploded
from tenodesis.errors import InstrumentError
from tenodesis.extras import require
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_file
from tenodesis.kinematics.gltf import BODY_NODE, described
from tenodesis.report import style
from tenodesis.run import Array

_CHORD, _TURN = 0.05, 0.3  # mm and rad: how closely a mesh follows its solid


def gltf(model: Model) -> bytes:
    """Return the assembly at straight joints as binary glTF, m, y upward.

    A node for each body, "body" and its name in :func:`tenodesis.kinematics.frames`, holds the parts in its own frame;
    those of a backbone's discs and of the bench are in the frame of the stem's distal end. The scene's extras say whose
    solids they are: joint type and lengths, m.
    """
    trimesh = require("trimesh", "cad")
    inst = model.instrument
    scene = trimesh.Scene(metadata={"tenodesis": {"name": inst.name, **described(inst)}})
    placed, colours = frames_of(model, 0.0, 0.0), colours_of(model)
    for part in model.parts:
        body = f"{BODY_NODE}{part.body}"
        scene.graph.update(body, matrix=_metres(matrix(placed(part, k.at()))))
        mesh = k.meshed(part.solid, _CHORD, _TURN)
        colour = [round(255 * share) for share in colours[part.name]]
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=[*colour, 255], metallicFactor=0.1, roughnessFactor=0.7, doubleSided=True
        )
        visual = trimesh.visual.TextureVisuals(material=material)
        shape = trimesh.Trimesh(1e-3 * mesh.points, mesh.faces, process=False, visual=visual)
        for number, place in enumerate(part.places):
            scene.add_geometry(
                shape,
                node_name=part.name if len(part.places) == 1 else f"{part.name}_{number + 1}",
                geom_name=part.name,
                parent_node_name=body,
                transform=_metres(matrix(place)),
            )
    found: bytes = scene.export(file_type="glb")
    return found


def _metres(place: Array) -> Array:
    found = place.copy()
    found[:3, 3] *= 1e-3
    return found


_AXES = "xyz"
_FIXED = ("end_effector", "tip", "grip")
"""Links without a mass of their own: their solids are counted with the far bodies they are fixed to."""
_FIXED_ENDS = ("_tip", "_grip")
_LEAST_MASS, _LEAST_INERTIA = 1e-6, 1e-9


def urdf(model: Model) -> str:
    """Return the text of the URDF file of :func:`tenodesis.kinematics.urdf`, with the solids' masses and inertias.

    A backbone and its discs are left out, since that model has its chord alone.
    """
    text = kinematics.urdf(model.instrument)
    root = fromstring(text, XMLParser(target=TreeBuilder(insert_comments=True)))
    bodies = inertias(model)
    for link in root.iter("link"):
        name = link.get("name", "")
        if name in bodies:
            _write(link, bodies[name])
        elif name in _FIXED or name.endswith(_FIXED_ENDS):
            _write(link, None)
    for note in root:
        if not isinstance(note.tag, str) and note.text:
            head, _, _ = note.text.partition("\n- masses:")
            note.text = f"{head}\n- masses: those of the solids of tenodesis cad, process {model.process.name}.\n"
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _write(link: Element, body: Inertia | None) -> None:
    old = link.find("inertial")
    if old is not None:
        link.remove(old)
    element = Element("inertial")
    centre = [0.0] * 3 if body is None else [float(one) for one in body.centre]
    SubElement(element, "origin", xyz=" ".join(map(repr, centre)), rpy="0 0 0")
    SubElement(element, "mass", value=repr(_LEAST_MASS if body is None else float(body.mass)))
    moments = {
        f"i{_AXES[row]}{_AXES[column]}": repr(
            float(body.about_centre[row, column]) if body is not None else _LEAST_INERTIA * (row == column)
        )
        for row in range(3)
        for column in range(row, 3)
    }
    SubElement(element, "inertia", moments)
    link.insert(0, element)


ASSEMBLY = "assembly.glb"
"""File of the assembly as glTF, which the console draws."""
INSTRUMENT = "instrument.toml"
FILES = (
    "assembly.step",
    ASSEMBLY,
    "drawings.pdf",
    "assembly.png",
    "assembly.svg",
    "exploded.png",
    "exploded.svg",
    "parts.csv",
    "geometry.json",
    "instrument.urdf",
    INSTRUMENT,
)
"""Files of a pack, beside a STEP file of each part in step/ and an STL file of each part to make in stl/."""
FOLDERS = ("step", "stl")
_COLUMNS = ("part", "title", "pieces", "make", "mass each [g]", "volume each [mm3]", "least wall [mm]", "support [mm2]")
_HEADING = "With the inertia of its tip by the solids of tenodesis cad, process {}."
_STEPS = 9  # angles over the working range
_SAME_VOLUME = 1e-6


@dataclass(frozen=True)
class Checks:
    """What was checked of a model's solids."""

    agreement: Agreement
    overlaps: tuple[Overlap, ...]
    play: Mapping[str, tuple[float, float]]
    """Angle by which each gear pair turns either way until its teeth touch, rad."""
    printable: tuple[Printable, ...]
    tip_inertia: float
    """About the first output angle, kg·m²."""
    instrument: Instrument
    """The instrument with that inertia, as its file in the pack has it."""


def check(model: Model, progress: Progress | None = None, *, steps: int = _STEPS) -> Checks:
    """Check a model's solids over the working range: interference at so many angles, mesh, tendons, tip.

    Raises InstrumentError if parts overlap; the message names the first two, the angle and the volume.
    """
    inst = model.instrument
    outputs, handles = (
        [float(share * most) for most in ranges(model, tip=tip)[:1] for share in np.linspace(-1, 1, steps)]
        for tip in (True, False)
    )
    overlaps = interference(model, [0.0, *outputs], handles, progress)
    if overlaps:
        one = overlaps[0]
        bent = f"output angle {math.degrees(one.output_angle):.0f} deg, handle {math.degrees(one.handle_angle):.0f} deg"
        remedy = "give a larger joint radius, a smaller output_range or a process with thinner walls"
        if any(name.startswith("rig_") for name in (one.first, one.second)):
            remedy = "the rig's place follows from the lengths of tip and end-effector, and from cable_pulley_radius"
        raise InstrumentError(
            f"{inst.name}: {one.first} and {one.second} share {one.volume * 1e9:.3g} mm3 at {bent}; {remedy}.",
            key=one.first,
            value=one.volume,
            allowed="apart",
        )
    play = {}
    for tip in (True, False):
        for number, station in enumerate(model.at(tip=tip)):
            if isinstance(station.sizes, GearJoint):
                if progress is not None:
                    progress(number, len(model.stations), "mesh of the gears")
                play[station.end.prefix] = mesh_play(model, 0.0, tip=tip, joint=number)
    return Checks(agreement(model), tuple(overlaps), play, (), tip_inertia(model), with_inertia(model))


def write(
    model: Model, folder: Path, tolerances: Mapping[str, float] | None = None, progress: Progress | None = None
) -> Checks:
    """Check a model and write its pack to a folder, all of it or nothing.

    Parameters
    ----------
    model
        The solids, from :func:`build`.
    folder
        Where the files go; made if absent.
    tolerances
        Half widths for the drawings, m, by key of the instrument file; see :func:`rows`.
    progress
        Called with how much is done, how much there is, and what is being done.

    Raises
    ------
    InstrumentError
        Parts overlap, or a mesh is not closed.
    OSError
        The folder cannot be written.
    """
    with files.atomic_files(folder) as new:
        return write_into(model, new, tolerances, progress)


def write_into(
    model: Model, folder: Path, tolerances: Mapping[str, float] | None = None, progress: Progress | None = None
) -> Checks:
    """Write as :func:`write` to an empty folder that is moved later."""
    report = progress or _silent
    found = check(model, report)
    for name in FOLDERS:
        (folder / name).mkdir()
    meshes = []
    for number, part in enumerate(model.parts):
        report(number, len(model.parts), "STEP and STL files")
        _write_step(part.solid, folder / "step" / f"{part.name}.step", part.name)
        if part.made:
            path = folder / "stl" / f"{part.name}.stl"
            write_mesh(model, part, str(path))
            meshes.append(printable(model, part, str(path)))
            if not meshes[-1].watertight:
                raise InstrumentError(f"{model.instrument.name}: the mesh of {part.name} is not closed.", key=part.name)
    found = replace(found, printable=tuple(meshes))
    report(0, 3, "assembly")
    _write_assembly(model, folder)
    report(1, 3, "pictures")
    with style.applied():
        for name, figure in (("assembly", draw_assembly(model)), ("exploded", draw_exploded(model))):
            figure.savefig(folder / f"{name}.png", dpi=150)
            figure.savefig(folder / f"{name}.svg", dpi=150, metadata={"Date": None})
    write_drawings(model, folder / "drawings.pdf", tolerances, progress=report)
    _write_parts(model, found, folder / "parts.csv")
    (folder / "geometry.json").write_text(json.dumps(_summary(model, found), indent=2) + "\n", "utf-8")
    (folder / "instrument.urdf").write_text(urdf(model), "utf-8")
    (folder / INSTRUMENT).write_text(to_file(found.instrument, comment=_HEADING.format(model.process.name)), "utf-8")
    report(1, 1, "written")
    return found


def _silent(done: float, total: float, doing: str) -> None:
    """Report to nobody."""


def _write_step(solid: Any, path: Path, label: str) -> None:
    """Write a STEP file, read it back, and compare the volumes."""
    b = k.kernel()
    solid.label = label
    b.export_step(solid, path)
    wanted, volume = k.volume(solid), sum(k.volume(one) for one in b.import_step(path).solids())
    if abs(volume / wanted - 1) > _SAME_VOLUME:
        raise InstrumentError(
            f"{path.name} reads back with a volume of {volume:.6g} mm3 instead of {wanted:.6g}; another process, or "
            f"sizes a little different, may avoid that.",
            key="volume",
            value=volume,
            allowed=f"{wanted:.6g} mm3",
        )


def _write_assembly(model: Model, folder: Path) -> None:
    b = k.kernel()
    pieces, colours = [], colours_of(model)
    for one in assembled(model, 0.0):
        piece = one.solid
        piece.label = one.name
        piece.color = b.Color(*colours[one.part.name])
        pieces.append(piece)
    whole = b.Compound(label=model.instrument.name, children=pieces)
    b.export_step(whole, folder / "assembly.step")
    (folder / ASSEMBLY).write_bytes(gltf(model))


def _write_parts(model: Model, found: Checks, path: Path) -> None:
    meshes = {one.part: one for one in found.printable}
    weighed = {one.part: one for one in masses(model)}
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_COLUMNS)
        for part in model.parts:
            mesh, pieces = meshes.get(part.name), len(part.places)
            writer.writerow(
                (
                    part.name,
                    part.title,
                    pieces,
                    f"{model.process.name}, {model.process.material}" if part.made else "bought",
                    f"{1e3 * weighed[part.name].mass / pieces:.4g}",
                    f"{part.solid.volume:.5g}",
                    "" if mesh is None else f"{1e3 * mesh.least_wall:.3g}",
                    "" if mesh is None else f"{1e6 * mesh.support:.3g}",
                )
            )


def _summary(model: Model, found: Checks) -> dict[str, Any]:
    return {
        "instrument": model.instrument.name,
        "process": model.process.name,
        "tip_inertia": found.tip_inertia,
        "bodies": {
            name: {"mass": one.mass, "centre": one.centre.tolist(), "inertia_about_centre": one.about_centre.tolist()}
            for name, one in inertias(model).items()
        },
        "rig_axes": [] if model.rig is None else [height / k.MM for height in (model.rig.pivot, *model.rig.others)],
        "mesh_play": found.play,
        "excursion_difference": found.agreement.excursion,
        "tip_difference": found.agreement.tip,
        "angles": found.agreement.angles,
        "overlaps": [one._asdict() for one in found.overlaps],
        "meshes": [one._asdict() for one in found.printable],
    }
