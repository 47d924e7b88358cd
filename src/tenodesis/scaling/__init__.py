"""Scale models: design from stock parts, workshop plan, and conversion of measurements to real-size units."""

from typing import TypeAlias

from tenodesis.errors import DesignError
from tenodesis.scaling.candidates import COMBINATIONS, Wheel
from tenodesis.scaling.catalogue import PINS, Catalogue, Constraints, json_schema, load, parse_pins, shipped
from tenodesis.scaling.design import Front, design, rivals_text
from tenodesis.scaling.joints import JointDesign, JointFront, design_joints, enlarged
from tenodesis.scaling.practical import Objective, Practical, PracticalFront, practical_front
from tenodesis.scaling.scale_model import Choice, Design, Objectives, TestLoad, name_of
from tenodesis.scaling.weights import WeightSelection, select_weights

AnyDesign: TypeAlias = Design | JointDesign
"""A design of one plane or of all joints."""

__all__ = [
    "COMBINATIONS",
    "PINS",
    "AnyDesign",
    "Catalogue",
    "Choice",
    "Constraints",
    "Design",
    "DesignError",
    "Front",
    "JointDesign",
    "JointFront",
    "Objective",
    "Objectives",
    "Practical",
    "PracticalFront",
    "TestLoad",
    "WeightSelection",
    "Wheel",
    "design",
    "design_joints",
    "enlarged",
    "json_schema",
    "load",
    "name_of",
    "parse_pins",
    "practical_front",
    "rivals_text",
    "select_weights",
    "shipped",
]


def __dir__() -> list[str]:
    return sorted(__all__)
