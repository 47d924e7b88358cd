"""Joints from commanded and measured angles alone: coupling, play, offsets (`model`), and their recordings."""

from tenodesis.identification.kinematic.model import Kinematic, is_kinematic, recorded
from tenodesis.identification.kinematic.recordings import of_run

__all__ = ["Kinematic", "is_kinematic", "of_run", "recorded"]
