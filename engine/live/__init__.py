"""The live engine: the only room with asyncio. What waits, what is dropped, and where the core runs."""
