"""`farside bench NAME`: measurements, a module each. The measuring itself is in `farside.engine.evaluation`."""

from .group import BenchGroup, command_group

__all__ = ["BenchGroup", "command_group"]
