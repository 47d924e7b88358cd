"""The instrument as URDF, with the masses and inertias of its solids."""

from xml.etree.ElementTree import Element, SubElement, TreeBuilder, XMLParser, fromstring, indent, tostring

from tenodesis import kinematics
from tenodesis.cad.masses import Inertia, inertias
from tenodesis.cad.model import Model

_AXES = "xyz"
_FIXED = ("end_effector", "tip", "grip")
"""Links without a mass of their own: their solids are counted with the far bodies they are fixed to."""
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
        elif name in _FIXED:
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
