"""Files: bounded reading, atomic writing, arrays on disk, hashes, the cache, and network weights."""
