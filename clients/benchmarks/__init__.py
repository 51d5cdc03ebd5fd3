"""What `farside bench` shows: a module a measurement. The measuring itself is in `farside.engine.evaluation`."""
