"""Limits on what is read of files of unknown origin, far above those of any run; see docs/threat-model.md.

What exceeds one is refused in a line, or counts as damage, before memory is allocated for it.
"""

from __future__ import annotations

RECORD_BYTES = 1 << 28
"""Size of a record of a log, such as an attachment: the rest is not read, so that its checksum fails. The files of a model
have at most 256 MiB together."""
CHUNK_BYTES = 1 << 28
"""Decompressed size of a chunk: a decompressor allocates what a chunk states. ffsm-mj closes one at 1 MiB plus a block of
rows."""
UNPACKED_BYTES, UNPACKED_RATIO = 1 << 30, 500
"""Decompressed size of all chunks, in bytes or relative to the file, against decompression bombs: rows compress to a fifth,
those of a system at rest to less."""
CHUNK_PARTS = 100_000
"""Stretches of equal records in a chunk, each of which costs a Python object; ffsm-mj writes a few for a block of rows or an
event."""
PARTS = 1_000_000
"""The same in the whole log, with all other records."""
EVENTS = 200_000
"""Messages on a topic of events, which are decoded one by one; a scenario ends a run at 10 000 impacts by default."""
ATTACHED_BYTES = 1 << 30
"""Size of all attachments, which are kept in memory."""
ATTACHMENTS, NAME_CHARACTERS = 10_000, 512
"""Number of attachments, and length of the name of one, which becomes a path: a model has at most 1000 files."""
SCHEMA_BYTES = 1 << 22
"""Size of the schema of a sample, parsed by protobuf; a column takes about 60 bytes."""
MESH_CORNERS = 2_000_000
"""Triangle corners of all drawn meshes, as geoms may share one; meshes beyond it are drawn as their bounding boxes."""
OUTLINE_POINTS = 100_000
"""Points on all edges of a body, and of each of its meshes; large bodies get a larger spacing."""
TABLE_BYTES = 64 * 1024**2
"""Size of a file with recorded numbers, which is split into cells in memory."""
