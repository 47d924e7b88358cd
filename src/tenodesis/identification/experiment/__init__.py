"""Experiment design: the bench protocol after which the wanted parameters of an instrument are known best."""

from tenodesis.identification.experiment.planning import DURATION, OPTIMISTIC, Block, Prediction, ProposedProtocol, plan

__all__ = ["DURATION", "OPTIMISTIC", "Block", "Prediction", "ProposedProtocol", "plan"]


def __dir__() -> list[str]:
    return sorted(__all__)
