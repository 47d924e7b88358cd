"""A coupled instrument as a URDF robot description."""

from tenodesis.coupled.parts import parts
from tenodesis.coupled.reading import CoupledLike, load
from tenodesis.kinematics.urdf import CONTINUUM, robot

NOTE = """Written by tenodesis. Units: m, rad, kg. The base is the stem's tip end; z points along the stem to the tip.
What this format does not contain:
- tendons: nothing ties the tip to the handle, nor a joint to others that its tendons cross, and nothing is elastic;
- springs in the joints;
- rolling contact: a gear pair is two revolute joints, half its angle each, the second a mimic of the first, which tools
  may ignore;
- friction, drives, sensors, the controller, and limits by loads: working ranges are mechanical stops;
- contact: jaws are two joints of their own, and grip no object;
- efforts and velocities: their values are there only because the format needs them;
- masses: parts are drawn, and weighed, as solid steel; links between a part's joints weigh 1 mg.{more}"""


def urdf(inst: CoupledLike) -> str:
    """Return an instrument as the text of a URDF file: links as the bodies of :func:`frames`.

    Positions of its joints are those of :func:`joint_positions`. What the format does not contain stands in its first
    lines.
    """
    inst = load(inst)
    is_continuum = any(joint.mechanism == "continuum" for joint in inst.joints)
    return robot(inst.name, NOTE.format(more=CONTINUUM if is_continuum else ""), "base", parts(inst, "urdf"))
