"""Optional dependencies are imported where they are used; without one, a sentence says what to install."""

import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from tenodesis.devices import nidaq_tasks, registry
from tenodesis.errors import Error, MissingExtraError
from tenodesis.extras import require
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen
from tenodesis.live.foxglove import Server


def with_can(inst: Instrument) -> Instrument:
    """An instrument whose bench is on a CAN bus, as far as that matters before its libraries are needed."""
    return inst.model_copy(update={"devices": inst.devices.model_copy(update={"canopen": CanOpen.model_construct()})})


def test_an_installed_module_is_returned():
    assert require("json.decoder", "live").JSONDecoder().decode("1") == 1


def test_a_missing_module_names_itself_and_the_extra_that_installs_it():
    with pytest.raises(MissingExtraError) as raised:
        require("a_module_nobody_has.part", "devices")
    problem = raised.value
    assert (problem.key, problem.value, problem.extra) == ("module", "a_module_nobody_has", "devices")
    assert str(problem) == (
        "a_module_nobody_has is not installed; it needs the extra [devices]: pip install 'tenodesis[devices]'."
    )
    assert isinstance(problem, Error)


def test_what_a_module_itself_cannot_import_is_not_hidden(tmp_path, monkeypatch):
    (tmp_path / "a_module_that_fails.py").write_text("import another_module_nobody_has\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="another_module_nobody_has"):
        require("a_module_that_fails", "live")


@pytest.mark.parametrize(
    ("module", "extra", "use"),
    [
        ("foxglove", "live", lambda inst: Server(SimpleNamespace(inst=inst, time_step=1e-3), port=0)),
        ("can", "devices", lambda inst: registry.make("canopen", with_can(inst))),
        ("canopen", "devices", lambda inst: registry.make("canopen", with_can(inst))),
        ("nidaqmx", "devices", lambda inst: nidaq_tasks._driver()),
        ("serial", "devices", lambda inst: registry.make("serial", inst, "/dev/null").open()),
    ],
)
def test_what_needs_an_extra_says_so_where_it_is_used(
    module: str, extra: str, use: Callable[[Instrument], object], scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError) as raised:
        use(scaled)
    assert (raised.value.value, raised.value.extra) == (module, extra)
