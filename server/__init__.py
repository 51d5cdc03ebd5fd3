"""FastAPI and WebSocket glue over the live engine."""
