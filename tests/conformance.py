"""Assertions on conformance."""

from __future__ import annotations

import re
from typing import Any

import pytest

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import RequirementMissing, WeightsError
from salframe.testing import Conformance, check_component


def conforms(component: type, config: Any = None) -> bool:
    """Return whether a component breaks no rule. Failed rules are printed in the output of the test."""
    conformance = check_component(component, config)
    print(*conformance.failed, sep="\n")
    return not conformance.failed


def breaks(message: str, component: type, config: Any = None) -> Conformance:
    """Assert that a rule failed with a message that matches a regular expression, and return the results."""
    conformance = check_component(component, config)
    messages = [result.message for result in conformance.failed]
    assert any(re.search(message, line) for line in messages), messages
    assert not any("\n" in line for line in messages)
    return conformance


def runnable(config: ComponentConfig) -> ComponentConfig:
    """Return the config. Skip the test if a package or weights of its component are not installed."""
    try:
        config.component.check(config)
    except (RequirementMissing, WeightsError) as error:
        pytest.skip(str(error))
    if any("torch" in inner.component.requires for inner in (config, getattr(config, "features", config))):
        import torch

        torch.set_num_threads(1)  # tests run in parallel, so more threads only slow each other down
    return config
