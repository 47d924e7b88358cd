"""The parts of a glTF file, drawn in the console's view in place of plain solids."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import kinematics
from tenodesis.console import assembly
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument
from tenodesis.kinematics import Posture
from tenodesis.kinematics.gltf import BODY_NODE, described

trimesh: Any = pytest.importorskip("trimesh")


def written(inst: Instrument, path: Path) -> Path:
    """Write an assembly of a few boxes for an instrument, laid out as the solids' own."""
    scene = trimesh.Scene(metadata={"tenodesis": described(inst)})
    colour = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[200, 140, 70, 255])
    )
    end = -kinematics.dimensions(inst).stem_length
    places = {"stem": ("stem", 0.0), "handle": ("stem", end), "tip": ("yaw_far", 0.0),
              "disc_1": ("arc", 0.02), "table": ("bench", 0.0)}  # fmt: skip
    for name, (body, along) in places.items():
        scene.graph.update(f"{BODY_NODE}{body}")
        box = trimesh.creation.box((0.01, 0.002, 0.004))
        box.visual = colour
        move = trimesh.transformations.translation_matrix([0.0, 0.0, along])
        scene.add_geometry(box, node_name=name, geom_name=name, parent_node_name=f"{BODY_NODE}{body}", transform=move)
    scene.export(path)
    return path


def test_parts_are_drawn_on_the_bodies_they_move_with(scaled: Instrument, tmp_path: Path) -> None:
    found = assembly.load(written(scaled, tmp_path / "assembly.glb"))
    assert {solid.name: solid.body for solid in found.solids} == {
        "stem": "stem", "handle": "stem", "tip": "yaw_far", "disc_1": "disc 0.02"
    }  # fmt: skip
    assert found.differs(scaled) == ""
    own = {solid.name: solid for solid in found.of(scaled, 0.1)}
    assert own["tip"].colour == (200, 140, 70)
    # The stem is drawn short: its handle's end comes to where the short stem ends, and the tip's end stays.
    assert own["handle"].mesh.centroid == pytest.approx([0, 0, -0.1], abs=1e-9)
    assert own["stem"].mesh.centroid == pytest.approx([0, 0, 0], abs=1e-9)


def test_parts_of_an_axis_of_another_name_are_turned_with_it(scaled: Instrument, tmp_path: Path) -> None:
    pitch = scaled.replace(axes=("pitch",))
    own = {solid.name: solid for solid in assembly.load(written(scaled, tmp_path / "a.glb")).of(pitch, 0.1)}
    assert own["tip"].body == "pitch_far"
    assert np.ptp(own["tip"].mesh.vertices, axis=0) == pytest.approx([0.002, 0.01, 0.004], abs=1e-8)


def test_parts_of_another_instrument_are_told_by_the_length_that_differs(scaled: Instrument, tmp_path: Path) -> None:
    found = assembly.load(written(scaled, tmp_path / "a.glb"))
    assert found.differs(scaled.replace(end_effector_length=0.09)).startswith(
        "end_effector_length of scaled-up is 90 mm"
    )
    assert "two bending axes" in found.differs(tn.load("real-size"))
    longer = {"handle_length": scaled.handle_length + 0.05, "overall_length": (scaled.overall_length or 0) + 0.05}
    assert found.differs(scaled.replace(**longer)).startswith("handle_length of scaled-up is")
    (tmp_path / "b.glb").write_bytes(b"no glTF")
    plain = trimesh.Scene(metadata={"tenodesis": described(scaled)})
    plain.add_geometry(trimesh.creation.box((1, 1, 1)))
    plain.export(tmp_path / "plain.glb")
    for name in ("b.glb", "none.glb", "plain.glb"):
        with pytest.raises(ArgumentError, match=rf"{name} cannot be shown: .* assembly.glb that tenodesis cad"):
            assembly.load(tmp_path / name)


def test_discs_stand_square_on_the_arc_of_their_backbone() -> None:
    stem = kinematics.Frame(np.array([0.1, 0.0, 0.2]), np.array([1.0, 0.0, 0.0, 0.0]))
    angle, length = math.radians(70), 0.05
    far = kinematics.Frame(stem.position, np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]))
    bend = length / angle
    for share in (0.0, 0.4, 1.0):
        place = assembly.disc_place(stem, far, share * length, length)
        turned = share * angle
        expected = stem.position + bend * np.array([1 - math.cos(turned), 0.0, math.sin(turned)])
        assert place.position == pytest.approx(expected, abs=1e-12)
        assert place.quaternion == pytest.approx([math.cos(turned / 2), 0, math.sin(turned / 2), 0], abs=1e-12)
    straight = assembly.disc_place(stem, stem, 0.02, length)
    assert straight.position == pytest.approx([0.1, 0.0, 0.22])


def test_every_body_of_the_parts_has_a_frame(scaled: Instrument, tmp_path: Path) -> None:
    found = assembly.load(written(scaled, tmp_path / "a.glb")).of(scaled, 0.1)
    bodies = kinematics.frames(scaled, Posture()).bodies
    assert {solid.body for solid in found if not solid.body.startswith(assembly.DISC)} <= bodies.keys()
