"""The assembly as glTF: a node for each body of the instrument, with the meshes of the parts that move with it."""

from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import frames_of, matrix
from tenodesis.cad.model import Model
from tenodesis.cad.picture import colours_of
from tenodesis.extras import require
from tenodesis.kinematics.gltf import BODY_NODE, described
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
