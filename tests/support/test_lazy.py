"""Attributes made at the first access: once, and without a thread that waits for another attribute."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

from farside.engine.support.lazy import lazy
from support.doubles import HANG_S


class Thing:
    def __init__(self, ready: threading.Event) -> None:
        self.ready, self.asked, self.made = ready, threading.Event(), 0

    @lazy
    def value(self) -> object:
        """The value, made at the first access."""
        self.made += 1
        self.asked.set()
        assert self.ready.wait(HANG_S)
        return object()


def test_it_is_made_once() -> None:
    ready = threading.Event()
    ready.set()
    thing = Thing(ready)
    assert thing.value is thing.value
    assert thing.made == 1


def test_no_object_waits_for_another_of_its_class_and_all_threads_get_the_same() -> None:
    slow, quick = Thing(threading.Event()), Thing(threading.Event())
    quick.ready.set()
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(lambda: slow.value) for _ in range(2)]
        assert slow.asked.wait(HANG_S)
        assert quick.value is not None
        assert not any(value.done() for value in waiting)
        slow.ready.set()
        assert waiting[0].result(HANG_S) is waiting[1].result(HANG_S) is slow.value
