"""The live engine, the only room with asyncio: it decides what waits, what is dropped, and where the core runs."""
