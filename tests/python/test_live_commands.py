"""The table of live commands: what may be sent, and as what."""

from typing import Any

import numpy as np
import pytest

from tenodesis.errors import LiveError
from tenodesis.live.commands import COMMANDS


@pytest.mark.parametrize(
    ("name", "arguments", "key"),
    [
        ("acquire", {"force": "console"}, "force"),
        ("acquire", {"force": 1}, "force"),
        ("record", {"on": "off", "called": "live"}, "on"),
        ("speed", {"factor": True}, "factor"),
        ("speed", {"factor": "2"}, "factor"),
        ("speed", {"factor": [1.0, 2.0]}, "factor"),
    ],
)
def test_an_argument_of_another_kind_is_refused_before_it_is_sent(
    name: str, arguments: dict[str, Any], key: str
) -> None:
    with pytest.raises(LiveError) as caught:
        COMMANDS[name].encode(arguments)
    assert caught.value.key == key
    assert caught.value.value == arguments[key]


def test_numbers_and_flags_of_numpy_are_sent_as_those_of_python() -> None:
    assert COMMANDS["speed"].encode({"factor": np.float32(2)}) == {"factor": 2.0}
    assert COMMANDS["acquire"].encode({"force": np.True_}) == {"force": True}
