"""Optional dependencies are imported where they are used; without one, a sentence says what to install."""

import pytest

from tenodesis.errors import Error, MissingExtraError
from tenodesis.extras import require


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
