from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import tenodesis as tn
from tenodesis.instrument import Instrument

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"

# No test depends on luck: the same examples every time, and no verdict by the clock.
settings.register_profile("repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def real() -> Instrument:
    return tn.load("real-size")


@pytest.fixture(scope="session")
def scaled() -> Instrument:
    return tn.load("scaled-up")


@pytest.fixture(scope="session")
def pulley() -> Instrument:
    return tn.load(EXAMPLES / "pulley.toml")


@pytest.fixture(scope="session")
def continuum() -> Instrument:
    return tn.load(EXAMPLES / "continuum.toml")


@pytest.fixture(params=["real", "scaled", "pulley", "continuum"])
def any_inst(request: pytest.FixtureRequest) -> Instrument:
    """Every mechanism, and both instruments of the paper."""
    inst: Instrument = request.getfixturevalue(request.param)
    return inst
