"""Optional dependencies are imported where they are used; without one, a sentence says what to install."""

import pickle
import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from tenodesis.devices import nidaq, registry
from tenodesis.errors import Error, MissingExtraError
from tenodesis.extras import require
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen
from tenodesis.live.foxglove import FoxgloveServer


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
    assert str(problem) == ("a_module_nobody_has is not installed: pip install 'tenodesis[devices]'.")
    assert isinstance(problem, Error)


def test_a_module_that_fails_to_import_is_one_sentence_with_the_cause(tmp_path, monkeypatch):
    (tmp_path / "a_module_that_fails.py").write_text("import another_module_nobody_has\n")
    (tmp_path / "a_module_without_its_driver.py").write_text("raise ImportError('libdriver.so: cannot open')\n")
    monkeypatch.syspath_prepend(tmp_path)
    for module, cause in (
        ("a_module_that_fails", "another_module_nobody_has"),
        ("a_module_without_its_driver", "libdriver.so"),
    ):
        with pytest.raises(MissingExtraError, match=rf"{module} cannot be imported \(.*{cause}.*\): pip install"):
            require(module, "live")


def test_the_exception_reaches_another_process_as_it_is():
    problem = pickle.loads(pickle.dumps(MissingExtraError("foxglove", "live")))
    assert (str(problem), problem.extra) == (str(MissingExtraError("foxglove", "live")), "live")


@pytest.mark.parametrize(
    ("module", "extra", "use"),
    [
        ("foxglove", "live", lambda inst: FoxgloveServer(SimpleNamespace(inst=inst, time_step=1e-3), port=0)),
        ("can", "devices", lambda inst: registry.make("canopen", with_can(inst))),
        ("canopen", "devices", lambda inst: registry.make("canopen", with_can(inst))),
        ("nidaqmx", "devices", lambda inst: nidaq._driver()),
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
