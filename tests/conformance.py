"""What tests say of conformance."""

from __future__ import annotations

import re
from typing import Any

from salframe.testing import Conformance, check_component


def conforms(component: type, config: Any = None) -> bool:
    """Whether a component breaks no rule; what it breaks stands in the test's output."""
    found = check_component(component, config)
    print(*found.failed, sep="\n")
    return not found.failed


def breaks(message: str, component: type, config: Any = None) -> Conformance:
    """What came of the rules, of which one is broken with this message (a regular expression), in one line."""
    found = check_component(component, config)
    said = [result.message for result in found.failed]
    assert any(re.search(message, line) for line in said), said
    assert not any("\n" in line for line in said)
    return found
