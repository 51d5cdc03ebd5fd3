"""A server with engines that stand in for the real one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from farside.engine.live.core import Core, Source
from support.doubles import Cores
from support.serving import running


@pytest.fixture
def cores() -> Callable[[Source], Core]:
    return Cores()


@pytest.fixture
def url(cores: Callable[[Source], Core]) -> Iterator[str]:
    with running(cores) as address:
        yield address
